"""RadSplat (Niemeyer et al. 2024, Sec. 4.3): what no ray sees much of goes.

The score of a primitive is its largest weight α T over all rays of all training views. Pruning is at steps 16,000 and
24,000, by a threshold in the paper; here each goes half of the way to the budget.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...scores.training_views import TrainingViews
from ...scores.weights import weights
from ...training.recipe import Recipe
from ...training.strategy.scheduler import PruningRule

DEVIATIONS = (
    "each prune goes half of the way to the budget, in log count (the paper has a threshold); there is no public code "
    "to check it with"
)


@dataclass(frozen=True)
class LargestWeight:
    """max α T."""

    def __call__(self, params: dict, views: TrainingViews, seed: int) -> np.ndarray:
        return weights(params, views.cameras, views.options, mask=views.mask).largest


RECIPE = Recipe(
    pruning=PruningRule(16_000, 24_000, check_every=8000, max_interval=8000, division=(0.5, 0.5), rounds=2),
    score=LargestWeight(),
)
