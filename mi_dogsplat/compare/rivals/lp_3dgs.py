"""LP-3DGS (Zhang et al. 2024): a mask on the importance, learned for a while, then one prune.

    m = sigmoid((log w S + g) / 0.5),  opacity <- m opacity,  loss + 5e-4 mean m

S is the importance (RadSplat's, the better of the two in the paper), w a weight per primitive that is learned at 0.01,
from 1 on, and g logistic noise, the difference of two Gumbel's (Gumbel-sigmoid). From step 19,500 to 20,000; then those
with the least w S go, for good: where m falls below a half in the paper, down to the budget here. A mask on the opacity
is one on α, but for the limit of .99. In a run of another length the step size changes inversely. That w is the odds
of m at S = 1 is our reading of "applied to the importance".
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false
from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.parameters import device_array
from ...engine.project import softplus
from ...training.presets import Recipe
from ...training.strategy.scheduler import PruningRule, scaled_milestone
from ...training.train import Trainer
from .radsplat import LargestWeight

FROM = 19_500  # step
LOG_WEIGHTS, IMPORTANCE = "log_mask_weights", "log_importance"
RATE, TEMPERATURE, WEIGHT = 0.01, 0.5, 5e-4
LEAST = 1e-6  # importance of what no ray sees


def masked_logits(logits: Any, mask_logits: Any) -> Any:
    """Logit of sigmoid(a) sigmoid(b), [N]; differentiable, and exact for opacities near 1."""
    log_product = -softplus(-logits) - softplus(-mask_logits)
    rest = dr.exp(-softplus(mask_logits)) + dr.exp(-softplus(-mask_logits) - softplus(logits))  # 1 - the product
    return log_product - dr.log(rest)


class LearnToPrune(Trainer):
    """Sees opacities through the mask from step ``FROM`` to the prune."""

    @property
    def _masking(self) -> bool:
        begun = self.pruning is not None and (self.pruning.scheduler is not None or self.pruning.skipped)
        return not begun and self.step_count >= scaled_milestone(FROM, self.config.steps / 30_000)

    def trained_params(self) -> dict:
        """Opacities times the mask."""
        if not self._masking:
            return self.optimizer.params
        if LOG_WEIGHTS not in self.optimizer.adam:
            self.optimizer.learn(IMPORTANCE, np.log(np.maximum(super()._scores(), LEAST)), 0.0)
            self.optimizer.learn(LOG_WEIGHTS, np.zeros(self.optimizer.n), RATE * 30_000 / self.config.steps)
        params = self.optimizer.params
        noise = device_array(self.rng.logistic(size=self.optimizer.n))
        self.mask_logits = (params[LOG_WEIGHTS] + dr.detach(params[IMPORTANCE]) + noise) / TEMPERATURE
        return params | {"logit_opacities": masked_logits(params["logit_opacities"], self.mask_logits)}

    def regularise(self, view: int, gradient: list) -> None:
        """The price of being there."""
        if self._masking:
            mask = dr.rcp(1 + dr.exp(-dr.detach(self.mask_logits)))
            weights = self.optimizer.adam[LOG_WEIGHTS]
            slope = mask * (1 - mask) / TEMPERATURE
            dr.set_grad(weights, dr.grad(weights) + slope * dr.opaque(mi.Float, WEIGHT / self.optimizer.n))

    def _scores(self) -> np.ndarray:
        """log w S, which is not needed any more; S alone where no step came between FROM and the prune."""
        if LOG_WEIGHTS not in self.optimizer.adam:
            return super()._scores()
        result = self.optimizer.numpy(LOG_WEIGHTS) + self.optimizer.numpy(IMPORTANCE)
        self.optimizer.forget(LOG_WEIGHTS)
        self.optimizer.forget(IMPORTANCE)
        return result


RECIPE = Recipe(pruning=PruningRule(20_000, 20_000, division=(1.0,), rounds=1), score=LargestWeight())
