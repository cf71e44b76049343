"""Brightness that curves over its primitive: what all that draw it, or turn it, agree on (docs/curvatures.md).

At w standard deviations along the axes of a primitive its three channels are brighter by ½ wᵀ Q w, with a symmetric
matrix Q of which a row holds the entries ``ENTRIES``.
"""

from __future__ import annotations

import numpy as np

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


MEAN_OF_TRACE = 1 / 6
"""By how much a trace of 1 makes a primitive brighter on average: what comes nearest to that in its pictures.

A picture shows two of three axes, and the squares of its weights exp(-|w|²) have the variance ½ along each: so of the
trace of Q it is ½ · ½ · 2/3.
"""


def mean_brightness(rows: Array) -> Array:
    """[B] by how much they make a primitive brighter on average."""
    return rows[:, :3].astype(np.float64).sum(axis=1) * MEAN_OF_TRACE
