"""Places that depend on the view, for the twins, in float64.

Seen along the unit vector v, from the camera to mu, the primitives `shift_index` [V] stand at

    mu + R S m,    m = A e,    e = R^T v - mean_views,    A = view_shifts [V, 3, 3]

For rays v is the direction of the ray.

A model that has no such arrays stands where it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..scene.row_groups import SHIFTS
from .directions import directions
from .own_axes import arrays_of, index_of
from .quaternions import rotations

if TYPE_CHECKING:
    from ..scene.cameras import Camera
    from ..scene.splats import Splats


def seen_from(splats: Splats, camera: Camera) -> np.ndarray:
    """[N, 3] where the camera sees the centres."""
    means, i = np.array(splats.means, np.float64), index_of(splats, SHIFTS)
    A, mean_views = arrays_of(splats, SHIFTS)
    _, _, e, R, scales = _parts(splats, camera, i, mean_views)
    means[i] += np.einsum("nxa,na,nab,nb->nx", R, scales, A, e)
    return means


def seen_along(splats: Splats, directions: np.ndarray) -> np.ndarray:
    """[P, N, 3] where the centres are on rays of the unit `directions` [P, 3]; [1, N, 3] in a model without shifts."""
    means, i = np.array(splats.means, np.float64)[None], index_of(splats, SHIFTS)
    if not len(i):
        return means
    A, mean_views = arrays_of(splats, SHIFTS)
    R, scales = _axes(splats, i)
    means = np.repeat(means, len(directions), axis=0)
    means[:, i] += np.einsum("nxa,na,nab,pnb->pnx", R, scales, A, np.einsum("nxa,px->pna", R, directions) - mean_views)
    return means


def shifts_backward(splats: Splats, camera: Camera, rows: np.ndarray,
                    δcentres: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """δmeans [v, 3], δlog_scales [v, 3], δω [v, 3] and δ of the arrays of the group, by name.

    `rows` [v] of the group; `δcentres` [v, 3] is by where the camera sees them. The primitive turns by R exp([ω]).
    """
    A, mean_views = arrays_of(splats, SHIFTS)
    v, distances, e, R, scales = _parts(splats, camera, index_of(splats, SHIFTS)[rows], mean_views[rows])
    moves = scales * np.einsum("nab,nb->na", A[rows], e)
    δmoves = np.einsum("nxa,nx->na", R, δcentres)
    δm = scales * δmoves
    δe = np.einsum("nab,na->nb", A[rows], δm)
    δω = np.cross(moves, δmoves) + np.cross(δe, e + mean_views[rows])
    δv = np.einsum("nxa,na->nx", R, δe)
    δmeans = (δv - v * (v * δv).sum(1, keepdims=True)) / distances
    δ = {"view_shifts": np.zeros_like(A), "mean_views": np.zeros_like(mean_views)}
    δ["view_shifts"][rows], δ["mean_views"][rows] = δm[:, :, None] * e[:, None, :], -δe
    return δmeans, moves * δmoves, δω, δ


def _parts(splats: Splats, camera: Camera, i: np.ndarray, mean_views: np.ndarray) -> tuple[np.ndarray, ...]:
    """v [v, 3], the distances [v, 1], e [v, 3], R [v, 3, 3] and scales [v, 3] of the primitives i [v]."""
    v, distances = directions(np.asarray(splats.means, np.float64)[i] - camera.position)
    R, scales = _axes(splats, i)
    return v, distances, np.einsum("nxa,nx->na", R, v) - mean_views, R, scales


def _axes(splats: Splats, i: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R [v, 3, 3] and scales [v, 3] of the primitives i [v]."""
    R = rotations(np.asarray(splats.quats, np.float64)[i])
    return R, np.exp(np.asarray(splats.log_scales, np.float64)[i])
