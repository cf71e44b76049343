"""Densification to a budget: as many primitives grow at each refinement as the budget of the step has room for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...scene.opacity import sigmoid
from ...training.strategy.densify import Choice, Densification
from ...training.strategy.strategy import Training

START_SHARE = 0.5  # of the budget, at most, that training starts with


def progress(t: Training, rule: Densification) -> float:
    """0 before, 1 at the last refinement."""
    first, last = -(-rule.start // rule.every), (rule.stop - 1) // rule.every
    return 1.0 if last <= first else (t.step_count // rule.every - first) / (last - first)


def removed(t: Training, rule: Densification) -> np.ndarray:
    """[N] who is removed, as in 3DGS; never all."""
    opacity = opacities(t)
    remove = opacity < rule.min_opacity
    if rule.removes_large(t.step_count):
        remove |= t.optimizer.largest_scales > rule.max_world_scale * t.extent
    if remove.all():
        remove[np.argmax(opacity)] = False  # an empty model cannot recover
    return remove


def bounded(budget: int, rule: Densification) -> int:
    """A budget within what a cap, or the memory, leaves."""
    return min(budget, rule.max_primitives or budget)


def opacities(t: Training) -> np.ndarray:
    """[N] float64."""
    return sigmoid(t.optimizer.numpy("logit_opacities").astype(np.float64))


def best(scores: np.ndarray, candidates: np.ndarray, count: int) -> np.ndarray:
    """[N] the ``count`` candidates [N] of the largest scores, or all of them."""
    rows = np.flatnonzero(candidates)
    chosen = np.zeros(len(scores), bool)
    chosen[rows[np.argsort(-scores[rows], kind="stable")[: max(0, count)]]] = True
    return chosen


def fill(t: Training, rule: Densification, budget: int, scores: Callable[[], np.ndarray]) -> Choice:
    """Remove as 3DGS does, then grow into the room that the budget leaves. What is split and cloned is as in 3DGS.

    Args:
        budget: primitives after this refinement.
        scores: [N] the largest grow first.
    """
    remove, small = removed(t, rule), t.optimizer.largest_scales <= rule.clone_scale * t.extent
    budget = bounded(budget, rule)
    return Choice(best(scores(), ~remove, budget - int(np.sum(~remove))), small, remove)
