"""The surface where a distance is 0, by scikit-image's marching cubes (Lewiner et al. 2003), chunk by chunk."""

from __future__ import annotations

import numpy as np
from skimage.measure import marching_cubes

from ..scene.splats import Array
from .blocks import SIDE, Blocks
from .mesh import Mesh

CHUNK = 8  # blocks along the edge of what is looked at in one piece
EDGE = CHUNK * SIDE  # voxels along it; each chunk sees the first voxels of the next


def zero_surface(blocks: Blocks, distances: Array) -> Mesh:
    """Triangles between voxels of different sign; where the distance of one of a cube is NaN, there are none.

    Args:
        blocks: B of them.
        distances: [B, SIDE, SIDE, SIDE] float32, positive outside.

    Vertices on the border of two chunks are one vertex of the mesh: both compute it from the same numbers. So are
    those that float32, as files have it, does not tell apart.
    """
    places = blocks.places
    owners = np.unique((places[:, None] - np.array(list(np.ndindex(2, 2, 2)))).reshape(-1, 3) // CHUNK, axis=0)
    vertices, faces, n = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for owner in owners:
        values = _chunk(blocks, distances, owner * CHUNK)
        is_known = np.isfinite(values)
        crossing = _all_corners(is_known) & _both_signs(values > 0)
        if not crossing.any():
            continue
        values[~is_known] = 1
        mask = np.pad(crossing, ((1, 0),) * 3)  # scikit-image reads it at the last corner of a cube
        found, corners, _, _ = marching_cubes(values, 0.0, mask=mask)
        vertices.append(found.astype(np.float64) + owner * EDGE)
        faces.append(corners.astype(np.int64) + n)
        n += len(found)
    positions = (blocks.centre + blocks.voxel * np.concatenate(vertices)).astype(np.float32)
    welded, same = np.unique(positions, axis=0, return_inverse=True)
    joined = same.reshape(-1)[np.concatenate(faces)]
    a, b, c = joined.T  # a voxel of distance 0 is the corner of triangles without area
    return Mesh(welded, joined[(a != b) & (b != c) & (c != a)])


def _chunk(blocks: Blocks, distances: Array, first: Array) -> Array:
    """[EDGE + 1]³ values from the block ``first`` on, NaN where no block is."""
    places = np.stack(np.meshgrid(*[np.arange(CHUNK + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    rows = blocks.rows(first + places)
    dense = np.full((CHUNK + 1,) * 3 + (SIDE,) * 3, np.nan, np.float32)
    there = rows >= 0
    dense[tuple(places[there].T)] = distances[rows[there]]
    side = (CHUNK + 1) * SIDE
    return dense.transpose(0, 3, 1, 4, 2, 5).reshape(side, side, side)[(slice(EDGE + 1),) * 3].copy()


def _all_corners(flags: Array) -> Array:
    """Of cubes: whether it holds at all eight corners; one less along each axis."""
    for axis in range(3):
        flags = np.logical_and(*_neighbours(flags, axis))
    return flags


def _both_signs(positive: Array) -> Array:
    """Of cubes: whether the corners are of both signs."""
    some = positive
    for axis in range(3):
        some = np.logical_or(*_neighbours(some, axis))
    return some & ~_all_corners(positive)


def _neighbours(values: Array, axis: int) -> tuple[Array, Array]:
    n = values.shape[axis]
    return values.take(range(n - 1), axis), values.take(range(1, n), axis)
