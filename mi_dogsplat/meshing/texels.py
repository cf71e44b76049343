"""Which pixels of a texture lie in which triangle, and where on the surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..scene.splats import Array
from .mesh import Mesh

AT_ONCE = 1 << 22  # pixels that are looked at in one piece


class Texels(NamedTuple):
    """The T pixels of a texture whose middles lie in triangles of a mesh."""

    row: Array
    """[T] int"""
    column: Array
    """[T] int"""
    points: Array
    """[T, 3] in units of the model"""
    normals: Array
    """[T, 3] of length 1, to the outside"""


def texels_of(mesh: Mesh) -> Texels:
    """Of a mesh with a texture; a pixel on an edge may be there twice. Rows count from the top, as ``uv`` does."""
    assert mesh.texture is not None
    size = len(mesh.texture.pixels)
    corners = mesh.texture.uv[mesh.faces] * size  # [F, 3, 2] in pixels
    first = np.clip(np.floor(corners.min(axis=1)), 0, size - 1).astype(np.int64)  # [F, 2] column, row
    n = np.clip(np.floor(corners.max(axis=1)), 0, size - 1).astype(np.int64) - first + 1
    ends = np.cumsum(n.prod(axis=1))
    parts = np.split(np.arange(len(n)), np.searchsorted(ends, np.arange(AT_ONCE, ends[-1], AT_ONCE)))
    found = [_within(corners, first, n, faces) for faces in parts if len(faces)]
    face, pixel, weights = (np.concatenate(column) for column in zip(*found, strict=True))
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    points = sum(weights[:, k, None] * corner[face] for k, corner in enumerate((a, b, c)))
    return Texels(pixel[:, 1], pixel[:, 0], np.asarray(points), normals[face])


def _within(corners: Array, first: Array, n: Array, faces: Array) -> tuple[Array, Array, Array]:
    """Of some faces: of each pixel whose middle they hold the face [T], column and row [T, 2], and the weights of the
    corners [T, 3]."""
    counts = n[faces].prod(axis=1)
    face = np.repeat(faces, counts)
    k = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    pixel = first[face] + np.stack([k % n[face, 0], k // n[face, 0]], axis=1)
    a, b, c = (corners[face, k] for k in range(3))
    middle = pixel + 0.5
    areas = np.stack([_area(middle, b, c), _area(a, middle, c), _area(a, b, middle)], axis=1)
    whole = areas.sum(axis=1, keepdims=True)
    weights = areas / np.where(whole == 0, 1, whole)
    held = (weights >= 0).all(axis=1) & (whole[:, 0] != 0)
    return face[held], pixel[held], weights[held]


def _area(a: Array, b: Array, c: Array) -> Array:
    """[P] twice the signed areas of triangles of points [P, 2]."""
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    return ux * vy - uy * vx
