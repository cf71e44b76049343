"""GaussianSpa (Zhang et al. 2025): sparse opacities by ADMM, alternating between training and projection.

    minimise  loss(o) + ρ/2 ‖o - z + u‖²,  z with at most κ entries that are not 0

Training sees the second term in its gradient; every 50 steps z becomes o + u on its κ largest entries and 0 elsewhere,
and the dual u grows by o - z. From step 15,200 to 25,200, with ρ = 5e-4; then those of the smallest opacity go. κ is
the budget.
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
from ...training.presets import Recipe
from ...training.strategy.scheduler import PruningRule
from ...training.strategy.strategy import Seen, Strategy, Training

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
        """Gradient of ρ/2 ‖o - z + u‖² by the logits; before it, every 50 steps, the other half of the alternation."""
        if not self.start <= t.step_count < self.stop:
            return
        if (t.step_count - self.start) % self.every == 0 or SPARSE not in t.optimizer.learned:
            self._project(t)
        params: dict[str, Any] = t.optimizer.params
        logits = params["logit_opacities"]
        opacity = dr.rcp(1 + dr.exp(-dr.detach(logits)))
        pull = (opacity - dr.detach(params[SPARSE]) + dr.detach(params[DUAL])) * opacity * (1 - opacity)
        dr.set_grad(logits, dr.grad(logits) + pull * dr.opaque(mi.Float, self.rho))

    def _project(self, t: Training) -> None:
        logits = t.optimizer.numpy("logit_opacities").astype(np.float64)
        opacity, count = np.exp(-np.logaddexp(0, -logits)), int(t.target)
        if SPARSE not in t.optimizer.learned:
            t.optimizer.learn(SPARSE, projected(opacity, count), 0.0)
            t.optimizer.learn(DUAL, np.zeros(len(opacity)), 0.0)
            return
        dual = t.optimizer.numpy(DUAL).astype(np.float64)
        sparse = projected(opacity + dual, count)
        t.optimizer.assign(SPARSE, sparse)
        t.optimizer.assign(DUAL, dual + opacity - sparse)

    def scores(self, t: Training, state: None, rest: Callable[[], np.ndarray]) -> np.ndarray:
        """The opacities; what held them is not needed any more."""
        for name in {SPARSE, DUAL} & t.optimizer.learned:
            t.optimizer.forget(name)
        return rest()


RECIPE = Recipe(
    pruning=PruningRule(TO, TO, division=(1.0,), rounds=1), score=ScoreRule("opacity"), also=(GaussianSpa(),)
)
