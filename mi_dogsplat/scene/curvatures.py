"""Brightness that curves over its primitive: what all that draw it, or turn it, agree on (docs/curvatures.md).

At w standard deviations along the axes of a primitive its three channels are brighter by ½ wᵀ Q w, with a symmetric
matrix Q of which a row holds the entries ``ENTRIES``.
"""

from __future__ import annotations

import numpy as np

from .across import across_views
from .row_groups import Array

ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
OF_MATRIX = [[ENTRIES.index((min(a, b), max(a, b))) for b in range(3)] for a in range(3)]
"""Which entry each of Q is."""


def matrices(rows: Array) -> Array:
    """Q [B, 3, 3] of rows [B, 6], float64."""
    return np.asarray(rows, np.float64)[:, OF_MATRIX]


def rows_of(matrices: Array) -> Array:
    """The rows [B, 6] of Q [B, 3, 3]."""
    return np.stack([matrices[:, a, b] for a, b in ENTRIES], axis=1)


def turned(rows: Array, turn: Array) -> Array:
    """The rows [B, 6] of T Q Tᵀ: those of Q when w has become T w, ``turn`` [B, 3, 3] being orthogonal."""
    return rows_of(turn @ matrices(rows) @ turn.swapaxes(1, 2))


MEAN_ACROSS = 1 / 4
"""By how much an entry of 1 on the diagonal of Q makes a primitive brighter on average, where its axis lies across.

It is what comes nearest in the picture, where the squares of the weights exp(-|w|²) have the variance ½ along the axis.
"""


def mean_brightness(rows: Array, log_scales: Array) -> Array:
    """[B] by how much they make primitives with ``log_scales`` [B, 3] brighter on average over views from all sides."""
    with np.errstate(invalid="ignore"):  # of values that are not finite
        return MEAN_ACROSS * (across_views(log_scales) * rows[:, :3]).sum(axis=1)
