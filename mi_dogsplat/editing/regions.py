"""Which primitives of a model lie where, are large or faint, or hang together; by their parameters alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

from ..scene.quaternions import rotation_from_quaternion
from ..scene.scales import finite_scales
from ..scene.splats import Array, Splats

NEIGHBOURS = 16  # nearest primitives that are looked at
DEVIATIONS = 2.0  # how far a primitive reaches


def in_box(splats: Splats, low: Sequence[float], high: Sequence[float]) -> Array:
    """[N] bool, centres within a box of the axes, its faces included."""
    within = (splats.means >= np.asarray(low)) & (splats.means <= np.asarray(high))  # [N, 3]
    return np.all(within, axis=1)


def in_sphere(splats: Splats, centre: Sequence[float], radius: float) -> Array:
    """[N] bool, centres within a sphere, its surface included."""
    offsets = splats.means.astype(np.float64) - np.asarray(centre)
    with np.errstate(over="ignore"):
        return (offsets**2).sum(axis=1) <= radius * radius  # which may be infinite, where a power would be an error


def largest_parts(splats: Splats, count: int) -> Array:
    """[N] bool, the ``count`` connected parts of most primitives; of equal ones the first in the model.

    Two primitives touch where one is among the 16 nearest of the other and their ellipsoids of two standard
    deviations meet on the line between their centres.
    """
    n = splats.n_splats
    if n < 2:
        return np.ones(n, bool)
    first, second, distances = _near_pairs(splats.means.astype(np.float64))
    direction = (splats.means[second].astype(np.float64) - splats.means[first]) / np.maximum(distances, 1e-300)[:, None]
    reach = sum(deviations_along(splats, ends, direction) for ends in (first, second))
    touch = distances <= DEVIATIONS * reach
    graph = coo_array((touch[touch], (first[touch], second[touch])), shape=(n, n))
    part = connected_components(graph, directed=False)[1]  # [N]
    sizes = np.bincount(part)
    return np.isin(part, np.argsort(-sizes, kind="stable")[:count])


def deviations_along(splats: Splats, rows: Array, directions: Array) -> Array:
    """[P] standard deviation of the primitives ``rows`` [P] along unit vectors [P, 3]; at least 0."""
    turns = rotation_from_quaternion(splats.quats[rows].astype(np.float64))  # [P, 3, 3]
    local = np.einsum("pki,pk->pi", turns, directions)  # along the axes of the primitives
    scales = finite_scales(splats.log_scales[rows])
    return np.linalg.norm(local * scales, axis=1)


def _near_pairs(means: Array) -> tuple[Array, Array, Array]:
    """Each primitive with its nearest ones: first [P], second [P], and their distances."""
    n = len(means)
    distances, near = cKDTree(means).query(means, min(NEIGHBOURS + 1, n))
    first = np.repeat(np.arange(n), near.shape[1])
    return first, near.ravel(), distances.ravel()
