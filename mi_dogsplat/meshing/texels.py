"""Which pixels of a texture lie in which triangle, and where in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene.splats import Array
from .mesh import Mesh

AT_ONCE = 1 << 22  # pixels that are looked at in one piece


@dataclass(frozen=True)
class Texels:
    """The T pixels of a texture whose middles lie in triangles of its mesh."""

    mesh: Mesh
    row: Array
    """[T] int, from the top, as ``uv`` counts"""
    column: Array
    """[T] int"""
    face: Array
    """[T] int"""
    weights: Array
    """[T, 3] of the corners of the face; their sum is 1"""

    def between(self, values: Array) -> Array:
        """[T, C] of values [V, C] at the vertices."""
        corners = self.mesh.faces[self.face]
        return np.asarray(sum(self.weights[:, k, None] * values[corners[:, k]] for k in range(3)))

    def normals(self) -> Array:
        """[T, 3] of the faces, of length 1, to the outside; 0 of a face without area."""
        a, b, c = (self.mesh.vertices[self.mesh.faces[:, k]].astype(np.float64) for k in range(3))
        normals = np.cross(b - a, c - a)
        return (normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300))[self.face]


def texels_of(mesh: Mesh, uv: Array, size: int) -> Texels:
    """Of a picture of ``size`` x ``size`` pixels in which vertices are at ``uv`` [V, 2]; one on an edge may be there
    twice."""
    corners = uv[mesh.faces] * size  # [F, 3, 2] in pixels
    first = np.clip(np.floor(corners.min(axis=1)), 0, size - 1).astype(np.int64)  # [F, 2] column, row
    n = np.clip(np.floor(corners.max(axis=1)), 0, size - 1).astype(np.int64) - first + 1
    (ux, uy), (vx, vy) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    double = ux * vy - uy * vx  # the area, with a sign
    flat = double == 0
    inverse = np.stack([vy, -vx, -uy, ux], axis=1) / np.where(flat, np.nan, double)[:, None]  # no pixel is in NaN
    ends = np.cumsum(n.prod(axis=1))
    parts = np.split(np.arange(len(n)), np.searchsorted(ends, np.arange(AT_ONCE, ends[-1], AT_ONCE)))
    found = [_within(corners[:, 0], inverse, first, n, faces) for faces in parts if len(faces)]
    face, pixel, weights = (np.concatenate(column) for column in zip(*found, strict=True))
    return Texels(mesh, pixel[:, 1], pixel[:, 0], face, weights)


def _within(origin: Array, inverse: Array, first: Array, n: Array, faces: Array) -> tuple[Array, Array, Array]:
    """Of some faces: of each pixel whose middle they hold the face [T], column and row [T, 2], and the weights of the
    corners [T, 3]."""
    counts = n[faces].prod(axis=1)
    face = np.repeat(faces, counts)
    k = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    row, column = np.divmod(k, n[face, 0])
    pixel = first[face] + np.stack([column, row], axis=1)
    x, y = (pixel + 0.5 - origin[face]).T
    xx, xy, yx, yy = inverse[face].T
    second, third = xx * x + xy * y, yx * x + yy * y
    weights = np.stack([1 - second - third, second, third], axis=1)
    held = (weights >= 0).all(axis=1)
    return face[held], pixel[held], weights[held]
