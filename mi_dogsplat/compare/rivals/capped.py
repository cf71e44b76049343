"""3DGS with no more primitives than the budget at any time: pruning, against not growing in the first place."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...training.recipe import Recipe
from ...training.strategy.densify import Choice, Densification, by_gradient
from ...training.strategy.densify_stats import DensifyStats
from ...training.strategy.strategy import Training
from .growth import bounded


@dataclass(frozen=True)
class CappedGrowth:
    """Who grows: as in 3DGS, those with the largest gradients first where not all fit into the budget."""

    def __call__(self, t: Training, rule: Densification, stats: DensifyStats) -> Choice:
        rule = replace(rule, max_primitives=bounded(int(t.target), rule))
        return by_gradient(rule, t.optimizer, stats, t.step_count, t.extent)


RECIPE = Recipe(densification=Densification(growth=CappedGrowth()), start_share=1.0)
