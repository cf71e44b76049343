"""Fewer triangles for the same surface: edges collapse where that moves it least (Garland and Heckbert 1997).

The library fast-simplification does that. Of itself it lets open surfaces shrink from their border, because no plane
says where that is. So a fence stands on the border meanwhile, as Garland and Heckbert have it.
"""

from __future__ import annotations

from dataclasses import dataclass

import fast_simplification
import numpy as np

from ..scene.splats import Array
from .mesh import Mesh

FAR = 0.25  # of the size of the box around the points that became one: where it is farther outside, it is astray


def simplified(mesh: Mesh, most: int) -> Mesh:
    """The mesh with at most ``most`` triangles, or with as few as the library finds where that is more.

    A vertex has the mean colour of those that became one in it. Two triangles that came to lie on each other are one.
    """
    if len(mesh.faces) <= most:
        return mesh
    centre = mesh.vertices.mean(axis=0, dtype=np.float64)  # far from the origin quadrics lose their digits
    unit = mesh.to_unit  # beyond some distance the library collapses nothing, and below another all in any order
    fenced = _Fenced.of((mesh.vertices - centre) * unit, mesh.faces)
    target = most + int(fenced.is_fence.sum())  # of all triangles: as if the fence kept all of its own
    while fenced.n_surface > most:
        fewer = fenced.collapsed(target)
        if len(fewer.faces) == len(fenced.faces):
            break
        fenced, target = fewer, len(fewer.faces) - (fewer.n_surface - most)
    vertices, faces = (fenced.points / unit + centre).astype(mesh.vertices.dtype), fenced.faces[~fenced.is_fence]
    colors = None if mesh.colors is None else _means(mesh.colors, fenced.became, len(vertices))
    return Mesh(vertices, faces, colors).with_faces(_distinct(faces))


@dataclass(frozen=True)
class _Fenced:
    """A surface with a fence on its border."""

    points: Array
    """[P, 3]"""
    faces: Array
    """[F, 3] int32"""
    is_top: Array
    """[P] bool, whether it is a point at the top of the fence"""
    became: Array
    """[V] in which point each vertex of the mesh is; -1 of one that is gone with all of its triangles"""

    @classmethod
    def of(cls, points: Array, faces: Array) -> _Fenced:
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
        n = len(points)
        codes, back = edges @ (n, 1), edges[:, ::-1] @ (n, 1)
        border = np.flatnonzero(~np.isin(codes, back))
        a, b = edges[border].T
        at, place = np.unique(np.concatenate([a, b]), return_inverse=True)  # points on the border
        corners = points[faces[border % len(faces)]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        up = np.zeros((len(at), 3))
        np.add.at(up, place, np.concatenate([normals, normals]))
        lengths = np.linalg.norm(up, axis=1, keepdims=True)
        height = np.linalg.norm(points[b] - points[a], axis=1).mean() if len(border) else 0.0
        tops = points[at] + height * up / np.where(lengths > 0, lengths, 1)
        top_a, top_b = n + place.reshape(2, -1)
        fence = np.stack([np.stack([b, a, top_a], 1), np.stack([b, top_a, top_b], 1)]).reshape(-1, 3)
        is_top = np.arange(n + len(at)) >= n
        every = np.concatenate([faces, fence]).astype(np.int32)
        return cls(np.concatenate([points, tops]), every, is_top, np.arange(n))

    @property
    def is_fence(self) -> Array:
        """[F] bool."""
        return np.any(self.is_top[self.faces], axis=1)

    @property
    def n_surface(self) -> int:
        """How many triangles are no fence."""
        return int((~self.is_fence).sum())

    def collapsed(self, target: int) -> _Fenced:
        """With ``target`` triangles, or more."""
        how = {"target_count": target, "return_collapses": True}
        *_, collapses = fast_simplification.simplify(self.points, self.faces, **how)
        points, faces, became = fast_simplification.replay_simplification(self.points, self.faces, collapses)
        points = _near_origin(points, self.points, became)
        is_top = np.zeros(len(points), bool)
        is_top[became[self.is_top & (became >= 0)]] = True
        still = np.where(self.became >= 0, became[self.became], -1)
        return _Fenced(points, faces.astype(np.int32), is_top, still)


def _near_origin(points: Array, before: Array, became: Array) -> Array:
    """Points [P, 3], each near those of ``before`` [V, 3] that became it: their mean where it is far outside of the box
    around them.

    On a flat wall, or an edge between two, the place that moves the surface least is undetermined along a plane or a
    line, and the library may find it anywhere.
    """
    low, high = np.full((2, len(points), 3), np.inf)
    left = became >= 0
    np.minimum.at(low, became[left], before[left])
    np.minimum.at(high, became[left], -before[left])
    high = -high
    outside = np.maximum(low - points, points - high).max(axis=1)
    astray = ~(outside <= FAR * np.linalg.norm(high - low, axis=1))  # or no number
    return np.where(astray[:, None], _means(before, became, len(points)), points)


def _distinct(faces: Array) -> Array:
    """[F] bool: one of each set of three different corners."""
    corners = np.sort(faces, axis=1)
    first = np.zeros(len(faces), bool)
    first[np.unique(corners, axis=0, return_index=True)[1]] = True
    return np.logical_and(first, (corners[:, :-1] != corners[:, 1:]).all(axis=1))


def _means(values: Array, group: Array, n: int) -> Array:
    """[n, C] means of the rows [V, C] of each group [V], of which -1 is none."""
    values, group = values[group >= 0], group[group >= 0]
    counts = np.bincount(group, minlength=n)
    sums = np.stack([np.bincount(group, column, n) for column in values.T], axis=1)
    return sums / np.maximum(counts, 1)[:, None]
