"""Places that depend on the view: what all that draw primitives, or turn them, agree on (docs/shifts.md).

Seen along the unit vector v, from the camera to where it is stored, a primitive with the axes R and the scales S stands
at μ + R S A (Rᵀ v - v̄), with its ``view_shifts`` A and its ``mean_views`` v̄. So v̄ is the view for which it stands at μ.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .quaternions import rotation_from_quaternion
from .row_groups import Array

if TYPE_CHECKING:
    from .splats import Splats


def seen_from(splats: Splats, position: Array) -> Array:
    """[N, 3] float64, where primitives stand as seen from a point."""
    i, places = splats.shift_index, splats.means.astype(np.float64)
    axes = rotation_from_quaternion(splats.quats[i].astype(np.float64))
    own = _own_views(places[i], axes, position) - splats.mean_views
    with np.errstate(invalid="ignore"):  # of values that are not finite
        moves = splats.scales[i] * np.einsum("vab,vb->va", splats.view_shifts.astype(np.float64), own)
        places[i] += np.einsum("vxa,va->vx", axes, moves)
    return places


def mean_views(means: Array, quats: Array, positions: Array) -> Array:
    """v̄ [N, 3], along the axes of primitives, of the views from ``positions`` [C, 3]: the mean of Rᵀ v over them.

    A camera at the very place of a primitive has no view of it, and counts as zero.
    """
    axes, places = rotation_from_quaternion(quats), np.asarray(means, np.float64)
    total = np.zeros((len(means), 3))
    for position in positions:
        total += _own_views(places, axes, position)
    return total / len(positions)


def _own_views(places: Array, axes: Array, position: Array) -> Array:
    """Rᵀ v [N, 3] as seen from ``position``; zero of what is at that very point."""
    view = places - position
    length = np.linalg.norm(view, axis=1, keepdims=True)
    return np.einsum("nxa,nx->na", axes, view / np.where(length > 0, length, 1))


def turned(shifts: Array, views: Array, moves: Array, directions: Array) -> tuple[Array, Array]:
    """(A' [V, 3, 3], v̄' [V, 3]) of the same primitives along other axes.

    Args:
        moves: [V, 3, 3] takes a move in standard deviations along the old axes to the new ones.
        directions: [V, 3, 3] takes a direction along the new axes to the old ones; it has an inverse.
    """
    with np.errstate(invalid="ignore"):  # of values that are not finite
        along = moves @ shifts.astype(np.float64) @ directions
        return along, np.einsum("vab,vb->va", np.linalg.inv(directions), views.astype(np.float64))


def box_of_places(splats: Splats) -> tuple[Array, Array]:
    """(low, high) [3] of where centres of primitives with shifts are, whatever the view; at least one has some.

    Where that is not finite, and so the primitive is not drawn, it is where it is stored.
    """
    i = splats.shift_index
    axes, means = rotation_from_quaternion(splats.quats[i].astype(np.float64)), splats.means[i].astype(np.float64)
    with np.errstate(invalid="ignore"):
        moves = (axes * splats.scales[i][:, None]) @ splats.view_shifts.astype(np.float64)  # R S A
        middle = -np.einsum("vxa,va->vx", moves, splats.mean_views)
        reach = np.linalg.norm(moves, axis=2)  # the most that a unit vector makes of a row
    low, high = (means + np.where(np.isfinite(away), away, 0) for away in (middle - reach, middle + reach))
    return low.min(axis=0), high.max(axis=0)
