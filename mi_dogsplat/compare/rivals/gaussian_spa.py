"""GaussianSpa (Zhang et al. 2025): sparse opacities by ADMM, alternating between training and projection.

    minimise  loss(o) + ρ/2 ‖o - z + u‖²,  z with at most κ entries that are not 0

Training sees the second term in its gradient; every 50 steps z becomes o + u on its κ largest entries and 0 elsewhere,
and the dual u grows by o - z. From step 15,200 to 25,200, with ρ = 5e-4; then those of the smallest opacity go. κ is
the budget.
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false
from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from ...scores.score import ScoreRule
from ...training.presets import Recipe
from ...training.strategy.scheduler import PruningRule, scaled_milestone
from ...training.train import Trainer

FROM, TO, EVERY = 15_200, 25_200, 50  # steps
RHO = 5e-4
SPARSE, DUAL = "sparse_opacities", "dual_opacities"


def projected(values: np.ndarray, count: int) -> np.ndarray:
    """The nearest [N] with at most ``count`` entries that are not 0: the largest stay."""
    result = np.zeros_like(values)
    kept = np.argsort(-values, kind="stable")[:count]
    result[kept] = values[kept]
    return result


class GaussianSpa(Trainer):
    """Pulls opacities towards a sparse target between ``FROM`` and ``TO``."""

    def regularise(self, view: int, gradient: list) -> None:
        """Gradient of ρ/2 ‖o - z + u‖² by the logits; before it, every 50 steps, the other half of the alternation."""
        factor = self.config.steps / 30_000
        start, stop = scaled_milestone(FROM, factor), scaled_milestone(TO, factor)
        if not start <= self.step_count < stop:
            return
        if (self.step_count - start) % scaled_milestone(EVERY, factor) == 0 or SPARSE not in self.optimizer.adam:
            self._project()
        adam = self.optimizer.adam
        logits = adam["logit_opacities"]
        opacity = dr.rcp(1 + dr.exp(-dr.detach(logits)))
        pull = (opacity - dr.detach(adam[SPARSE]) + dr.detach(adam[DUAL])) * opacity * (1 - opacity)
        dr.set_grad(logits, dr.grad(logits) + pull * dr.opaque(mi.Float, RHO))

    def _project(self) -> None:
        logits = self.optimizer.numpy("logit_opacities").astype(np.float64)
        opacity, count = np.exp(-np.logaddexp(0, -logits)), int(self.config.target)
        if SPARSE not in self.optimizer.adam:
            self.optimizer.learn(SPARSE, projected(opacity, count), 0.0)
            self.optimizer.learn(DUAL, np.zeros(len(opacity)), 0.0)
            return
        dual = self.optimizer.numpy(DUAL).astype(np.float64)
        sparse = projected(opacity + dual, count)
        self.optimizer.set(SPARSE, sparse)
        self.optimizer.set(DUAL, dual + opacity - sparse)

    def _scores(self) -> np.ndarray:
        """The opacities; what held them is not needed any more."""
        for name in {SPARSE, DUAL} & self.optimizer.other_rates.keys():
            self.optimizer.forget(name)
        return super()._scores()


RECIPE = Recipe(pruning=PruningRule(TO, TO, division=(1.0,), rounds=1), score=ScoreRule("opacity"))
