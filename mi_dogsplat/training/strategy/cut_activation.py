"""Primitives that a plane cuts off in training: all get cuts, and those that stay whole, or nearly so, lose them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...scene.cuts import LARGEST, OFFSET
from ...scene.opacity import sigmoid
from ...scene.row_groups import PLANES, SECOND_CUTS, RowGroup
from ..optimizer.splat_optimizer import SplatOptimizer
from .row_activation import RowRule
from .strategy import Training

BEGUN = 0.05  # standard deviation of each number of a second normal at the start; no α changes by more than 1/255
DISTANCES = np.linspace(0.05, 3.5, 70)  # standard deviations; beyond, a kernel is below 1/255 itself


@dataclass(frozen=True)
class CutRule(RowRule):
    """``least``: of α; cuts that change it by less everywhere are left out."""

    least_of = "α"


def largest_change(lengths: np.ndarray) -> np.ndarray:
    """By how much a cut changes a kernel with the peak 1 at most, for lengths |n| of its normal, in float64.

    At w standard deviations G (1 - g) is largest against the normal, where n·w = -|n| r and r = |w|:

        exp(-r²/2) (1 - exp(-|n| r)) / (1 + exp(4 - |n| r)),

    of which this is the maximum over r. It grows with |n|. On the other side g is 1 + e⁻⁴ at most and changes less.
    """
    lengths, largest = np.asarray(lengths, np.float64), np.zeros(np.shape(lengths))
    for r in DISTANCES:
        x = lengths * r
        np.maximum(largest, np.exp(-r * r / 2) * -np.expm1(-x) / (1 + np.exp(OFFSET - x)), out=largest)
    return largest


def shown_cuts(rule: RowRule, optimizer: SplatOptimizer, plane: RowGroup) -> np.ndarray:
    """[C] whether a cut may change the α of some pixel by ``rule.least``, where it does not end at 1/255 anyway.

    A pixel at the offset d sees g at w = E[w | d], and |w|² is at most dᵀ Σ'⁻¹ d: the kernel over the image is no
    larger there than exp(-|w|²/2), so that opacity times ``largest_change`` bounds the change. α of a DoG primitive
    is a difference of two kernels that change in the same direction, by no more than the wider of them does. With
    scales F > 1 the pseudo-Gaussian is that: at F w it is as large as the primary at w, as if n were F times as long.
    A second plane may make what it leaves 1 + e⁻⁴ times as large.
    """
    index, (normals,) = optimizer.index_of(plane), plane.names
    lengths = np.linalg.norm(optimizer.numpy(normals).reshape(-1, 3).astype(np.float64), axis=1)
    if optimizer.n_dog:
        widths = np.ones(optimizer.n)
        wider = optimizer.numpy("dog_log_scales").reshape(-1, 3).max(axis=1)
        widths[optimizer.dog_index] = np.exp(np.clip(wider, 0, 700.0))
        lengths = lengths * widths[index]
    opacities = sigmoid(optimizer.numpy("logit_opacities")[index].astype(np.float64))
    others = sum(len(optimizer.index_of(group)) > 0 for group in PLANES if group is not plane)
    return opacities * largest_change(lengths) * LARGEST**others >= rule.least


def begun_second_cuts(t: Training) -> Mapping[str, np.ndarray]:
    """Second normals begin at random: two planes that begin alike would stay alike."""
    (name,) = SECOND_CUTS.names
    return {name: t.rng.normal(scale=BEGUN, size=(t.optimizer.n, 3)).astype(np.float32)}
