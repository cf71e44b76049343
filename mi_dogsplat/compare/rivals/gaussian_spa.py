"""GaussianSpa (Zhang et al. 2025): sparse opacities by ADMM, alternating between training and projection.

    minimise  loss(o) + ρ/2 ‖o - z + u‖²,  z with at most κ entries that are not 0

From step 15,200 to 25,200, with ρ = 5e-4. Training sees the second term in its gradient in every 50th step, not in all,
as in the authors' code; after that step's gradient z becomes o + u on its κ largest entries and 0 elsewhere, and the
dual u grows by o - z. At the end those of the smallest opacity go. κ is the budget.

The base of it is Mini-Splatting: at step 15,000 half of the primitives is drawn, with probabilities in proportion to
Σ α T + 1, and they begin anew (``reinitialize.py``). A half and then a fifth is a tenth: the parts of the way here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...scores.score import ScoreRule
from ...training.milestones import scaled_milestone
from ...training.recipe import Recipe
from ...training.strategy.scheduler import PruningRule
from ...training.strategy.strategy import Seen, Strategy, Training
from .growth import opacities
from .mini_splatting import SummedWeight, sampling_keys
from .reinitialize import FIRST, RESTARTED, Reinitialize
from .step_sizes import OPACITY_OF_2023

DEVIATIONS = (
    "no blur split and no points from depth during densification, because all methods share one start; all SH degrees "
    "at once after the restart; indoor importance, not divided by the area, for all captures; 30,000 steps (the "
    "stored copy of the code: 40,000); checked with a public copy of the code, because the authors' own was not "
    "available"
)
FROM, TO = 15_200, 25_200  # steps
SPARSE, DUAL = "sparse_opacities", "dual_opacities"


def projected(values: np.ndarray, count: int) -> np.ndarray:
    """The nearest [N] with at most ``count`` entries that are not 0: the largest stay."""
    result = np.zeros_like(values)
    kept = np.argsort(-values, kind="stable")[:count]
    result[kept] = values[kept]
    return result


@dataclass(frozen=True)
class GaussianSpa(Strategy[None]):
    """Pulls opacities towards a sparse target between ``start`` and ``stop``."""

    start: int = FROM
    stop: int = TO
    every: int = 50  # steps between projections
    rho: float = 5e-4

    def scaled(self, factor: float) -> GaussianSpa:
        start, stop, every = (scaled_milestone(step, factor) for step in (self.start, self.stop, self.every))
        return replace(self, start=start, stop=stop, every=every)

    def after_backward(self, t: Training, state: None, seen: Seen) -> None:
        """In every 50th step the gradient of ρ/2 ‖o - z + u‖² by the logits, then the other half of the alternation."""
        if not self.start <= t.step_count < self.stop:
            return
        if SPARSE not in t.optimizer.learned:
            opacity = opacities(t)
            t.optimizer.learn(SPARSE, projected(opacity, int(t.target)), 0.0)
            t.optimizer.learn(DUAL, np.zeros(len(opacity)), 0.0)
        if (t.step_count + 1 - self.start) % self.every:
            return
        params: dict[str, Any] = t.optimizer.params
        logits = params["logit_opacities"]
        opacity = dr.rcp(1 + dr.exp(-dr.detach(logits)))
        pull = (opacity - dr.detach(params[SPARSE]) + dr.detach(params[DUAL])) * opacity * (1 - opacity)
        dr.set_grad(logits, dr.grad(logits) + pull * dr.opaque(mi.Float, self.rho))
        if seen.last:
            self._project(t)

    def _project(self, t: Training) -> None:
        opacity, dual = opacities(t), t.optimizer.numpy(DUAL).astype(np.float64)
        sparse = projected(opacity + dual, int(t.target))
        t.optimizer.assign(SPARSE, sparse)
        t.optimizer.assign(DUAL, dual + opacity - sparse)

    def scores(self, t: Training, state: None, rest: Callable[[], np.ndarray]) -> np.ndarray:
        """Before the alternation a draw by importance; after it the opacities, and what held them is not needed."""
        if t.step_count < self.start:
            return sampling_keys(t.importance(SummedWeight()) + 1, t.rng)
        for name in {SPARSE, DUAL} & t.optimizer.learned:
            t.optimizer.forget(name)
        return rest()


RECIPE = Recipe(
    pruning=PruningRule(FIRST, TO, check_every=TO - FIRST, max_interval=TO - FIRST, division=(0.3, 0.7), rounds=2),
    score=ScoreRule("opacity"),
    also=(GaussianSpa(), Reinitialize(), OPACITY_OF_2023),
    refinement=RESTARTED,
)
