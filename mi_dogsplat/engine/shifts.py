"""Places that depend on the view: where a camera sees a primitive, one lane per primitive (docs/shifts.md).

Seen along v it stands at μ + R S A (Rᵀ v - v̄), see ``scene/shifts.py``. Colours and normals stay those along v.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

ROW = 9  # of ``view_shifts``, axis of the move first
VIEW_ROW = 3  # of ``mean_views``


def shift(view: list, R: list, scales: list, shifts: list, mean_views: list, active: Any) -> list:
    """By how much primitives move, in world space: x, y, z; [N] each, and 0 for those without.

    Args:
        view: v, a unit vector: x, y, z.
        R: rotation, 3 x 3; scales: 3 arrays.
        shifts: ``ROW`` arrays, mean_views: ``VIEW_ROW`` arrays.
        active: which have some.
    """
    own = [dr.fma(R[0][k], view[0], dr.fma(R[1][k], view[1], R[2][k] * view[2])) - mean_views[k] for k in range(3)]
    moves = [
        scale * dr.fma(shifts[3 * a], own[0], dr.fma(shifts[3 * a + 1], own[1], shifts[3 * a + 2] * own[2]))
        for a, scale in enumerate(scales)
    ]
    world = [dr.fma(row[0], moves[0], dr.fma(row[1], moves[1], row[2] * moves[2])) for row in R]
    return [dr.select(active, value, 0) for value in world]  # no row of zeros: a scale may be infinite
