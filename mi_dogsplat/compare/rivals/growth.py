"""Densification to a budget: as many primitives grow at each refinement as the budget of the step has room for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...datasets import Dataset
from ...training.config import TrainConfig
from ...training.presets import Recipe
from ...training.strategy.densify import Densification, grow_and_remove
from ...training.train import Trainer

START_SHARE = 0.5  # of the budget, at most, that training starts with


class Growth(Trainer):
    """Starts small and ends its densification with exactly ``config.target`` primitives, a count.

    What is removed, what is split and what is cloned is decided as in 3DGS; how many grow by ``budget``, and who by
    ``growth_scores``, which subclasses give.
    """

    def __init__(self, config: TrainConfig, dataset: Dataset, recipe: Recipe | None = None):
        self.count = int(config.target)
        start = max(1, int(START_SHARE * self.count))
        super().__init__(replace(config, target=0.5, max_primitives=start), dataset, recipe)
        self.config = config
        self.n_start = self.optimizer.n

    def progress(self) -> float:
        """0 before, 1 at the last refinement."""
        rule = self.densification
        first, last = -(-rule.start // rule.every), (rule.stop - 1) // rule.every
        return 1.0 if last <= first else (self.step_count // rule.every - first) / (last - first)

    def budget(self) -> int:
        """Primitives after the refinement of this step."""
        raise NotImplementedError

    def growth_scores(self) -> np.ndarray:
        """[N] the largest grow first."""
        raise NotImplementedError

    def refine(self, rule: Densification) -> dict[str, int]:
        """Remove as 3DGS does, then grow into the room that the budget leaves."""
        largest = np.exp(np.clip(self.optimizer.numpy("log_scales").max(1), -80, 80))  # [N] world units
        opacity = np.exp(-np.logaddexp(0, -self.optimizer.numpy("logit_opacities").astype(np.float64)))
        remove = opacity < rule.min_opacity
        if rule.removes_large(self.step_count):
            remove |= largest > rule.max_world_scale * self.extent
        if remove.all():
            remove[np.argmax(opacity)] = False  # an empty model cannot recover
        alive = np.flatnonzero(~remove)
        room = max(0, self.budget() - len(alive))
        grow = np.zeros(len(remove), bool)
        grow[alive[np.argsort(-self.growth_scores()[alive], kind="stable")[:room]]] = True
        small = largest <= rule.clone_scale * self.extent
        return grow_and_remove(self.optimizer, grow, small, remove, rule.split_divisor, self.rng)
