"""Places that depend on the view in training: all primitives get shifts, and those that hardly move lose them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...scene.opacity import sigmoid
from ...scene.row_groups import RowGroup
from ...scene.shifts import mean_views
from ..optimizer.splat_optimizer import SplatOptimizer
from .row_activation import RowRule
from .strategy import Training

STEEPEST = math.exp(-0.5)  # of a kernel with the peak 1, per standard deviation


@dataclass(frozen=True)
class ShiftRule(RowRule):
    """``least``: of α; shifts that change it by less everywhere are left out."""

    least_of = "α"


def shown_shifts(rule: RowRule, optimizer: SplatOptimizer, group: RowGroup) -> np.ndarray:
    """[V] whether a shift may change the α of some pixel by ``rule.least``.

    It moves a primitive by |A e| standard deviations at most, where e = Rᵀ v - v̄ is at most 1 + |v̄| long. A kernel
    then changes by no more than its peak times ``STEEPEST`` times that, and by no more than its peak. The
    pseudo-Gaussian of a DoG primitive is f_a as high, and narrower where a factor F is below 1.
    """
    index = optimizer.index_of(group)
    shifts, views = (optimizer.numpy(name).astype(np.float64) for name in group.names)
    largest = np.linalg.norm(shifts.reshape(-1, 3, 3), ord=2, axis=(1, 2)) * (1 + np.linalg.norm(views, axis=1))
    of_kernels = np.minimum(STEEPEST * largest, 1)
    if optimizer.n_dog:
        narrow = np.exp(-optimizer.numpy("dog_log_scales").reshape(-1, 3).astype(np.float64).min(axis=1))
        heights, factors = np.zeros(optimizer.n), np.ones(optimizer.n)
        heights[optimizer.dog_index] = sigmoid(optimizer.numpy("dog_logit_opacities").astype(np.float64))
        factors[optimizer.dog_index] = narrow
        of_kernels += heights[index] * np.minimum(STEEPEST * largest * factors[index], 1)
    return sigmoid(optimizer.numpy("logit_opacities")[index].astype(np.float64)) * of_kernels >= rule.least


def begun_shifts(t: Training) -> Mapping[str, np.ndarray]:
    """Every primitive is where it was, as it is seen on average."""
    means, quats = t.optimizer.numpy("means"), t.optimizer.numpy("quats")
    return {"mean_views": mean_views(means, quats, t.photographs.positions).astype(np.float32)}
