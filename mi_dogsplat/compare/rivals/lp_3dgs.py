"""LP-3DGS (Zhang et al. 2024): a mask on the importance, learned for a while, then one prune.

    m = sigmoid((log w S + g) / 0.5),  opacity <- m opacity,  loss + 5e-4 mean m

S is the importance (RadSplat's, the better of the two in the paper), w a weight per primitive that is learned at 0.01,
from 1 on, and g logistic noise, the difference of two Gumbel's (Gumbel-sigmoid). From step 19,500 to 20,000; then those
with the least w S go, for good: where m falls below a half in the paper, down to the budget here. A mask on the opacity
is one on α, but for the limit of .99. In a run of another length the step size changes inversely. That w is the odds
of m at S = 1 is our reading of "applied to the importance".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.activations import softplus
from ...engine.parameters import device_array
from ...training.milestones import scaled_milestone
from ...training.recipe import Recipe
from ...training.strategy.scheduler import PruningRule
from ...training.strategy.strategy import Seen, Strategy, Training
from .radsplat import LargestWeight

DEVIATIONS = (
    "pruned to the budget (in the paper the mask determines the number); that the weight is the odds of the mask at "
    "importance 1 is our interpretation; step sizes of the mask are those of 30,000 steps; not checked with the code, "
    "which was not available"
)
FROM, TO = 19_500, 20_000  # steps
LOG_WEIGHTS, IMPORTANCE = "log_mask_weights", "log_importance"
MASK_LOGITS = "mask_logits"  # of a step, with its noise
RATE, TEMPERATURE, WEIGHT = 0.01, 0.5, 5e-4
LEAST = 1e-6  # importance of what no ray sees


def masked_logits(logits: Any, mask_logits: Any) -> Any:
    """Logit of sigmoid(a) sigmoid(b), [N]; differentiable, and exact for opacities near 1."""
    log_product = -softplus(-logits) - softplus(-mask_logits)
    rest = dr.exp(-softplus(mask_logits)) + dr.exp(-softplus(-mask_logits) - softplus(logits))  # 1 - the product
    return log_product - dr.log(rest)


@dataclass(frozen=True)
class LearnToPrune(Strategy[None]):
    """Sees opacities through the mask from step ``start`` to the prune, at step ``stop``."""

    start: int = FROM
    stop: int = TO

    def scaled(self, factor: float) -> LearnToPrune:
        return LearnToPrune(scaled_milestone(self.start, factor), scaled_milestone(self.stop, factor))

    def params(self, t: Training, state: None, params: dict) -> dict:
        """Opacities times the mask."""
        if not self.start <= t.step_count < self.stop:
            return params
        if LOG_WEIGHTS not in t.optimizer.learned:
            t.optimizer.learn(IMPORTANCE, np.log(np.maximum(t.importance(LargestWeight()), LEAST)), 0.0)
            t.optimizer.learn(LOG_WEIGHTS, np.zeros(t.optimizer.n), RATE * 30_000 / t.steps)
            params = t.optimizer.params
        noise = device_array(t.rng.logistic(size=t.optimizer.n))
        logits = (params[LOG_WEIGHTS] + dr.detach(params[IMPORTANCE]) + noise) / TEMPERATURE
        return params | {"logit_opacities": masked_logits(params["logit_opacities"], logits), MASK_LOGITS: logits}

    def after_backward(self, t: Training, state: None, seen: Seen) -> None:
        """The price of being there."""
        if MASK_LOGITS in seen.params:
            mask = dr.rcp(1 + dr.exp(-dr.detach(seen.params[MASK_LOGITS])))
            weights = seen.params[LOG_WEIGHTS]
            slope = mask * (1 - mask) / TEMPERATURE
            dr.set_grad(weights, dr.grad(weights) + slope * dr.opaque(mi.Float, WEIGHT / t.optimizer.n))

    def scores(self, t: Training, state: None, rest: Callable[[], np.ndarray]) -> np.ndarray:
        """log w S, which is not needed any more; S alone where no step came between start and the prune."""
        if LOG_WEIGHTS not in t.optimizer.learned:
            return rest()
        result = t.optimizer.numpy(LOG_WEIGHTS) + t.optimizer.numpy(IMPORTANCE)
        t.optimizer.forget(LOG_WEIGHTS)
        t.optimizer.forget(IMPORTANCE)
        return result


RECIPE = Recipe(pruning=PruningRule(TO, TO, division=(1.0,), rounds=1), score=LargestWeight(), also=(LearnToPrune(),))
