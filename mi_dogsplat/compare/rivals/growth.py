"""Densification to a budget: as many primitives grow at each refinement as the budget of the step has room for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...training.strategy.densify import Choice, Densification
from ...training.strategy.strategy import Training

START_SHARE = 0.5  # of the budget, at most, that training starts with


def progress(t: Training, rule: Densification) -> float:
    """0 before, 1 at the last refinement."""
    first, last = -(-rule.start // rule.every), (rule.stop - 1) // rule.every
    return 1.0 if last <= first else (t.step_count // rule.every - first) / (last - first)


def fill(t: Training, rule: Densification, budget: int, scores: Callable[[], np.ndarray]) -> Choice:
    """Remove as 3DGS does, then grow into the room that the budget leaves. What is split and cloned is as in 3DGS.

    Args:
        budget: primitives after this refinement.
        scores: [N] the largest grow first.
    """
    largest = np.exp(np.clip(t.optimizer.numpy("log_scales").max(1), -80, 80))  # [N] world units
    opacity = np.exp(-np.logaddexp(0, -t.optimizer.numpy("logit_opacities").astype(np.float64)))
    remove = opacity < rule.min_opacity
    if rule.removes_large(t.step_count):
        remove |= largest > rule.max_world_scale * t.extent
    if remove.all():
        remove[np.argmax(opacity)] = False  # an empty model cannot recover
    alive = np.flatnonzero(~remove)
    room = max(0, budget - len(alive))
    grow = np.zeros(len(remove), bool)
    grow[alive[np.argsort(-scores()[alive], kind="stable")[:room]]] = True
    return Choice(grow, largest <= rule.clone_scale * t.extent, remove)
