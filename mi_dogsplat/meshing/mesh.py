"""A triangle mesh in memory, and which of its parts are worth having."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..scene.splats import Array


@dataclass(frozen=True)
class Texture:
    """A picture that lies on a mesh."""

    uv: Array
    """[V, 2] where each vertex is in it, 0..1: to the right, and down from the top"""
    pixels: Array
    """[H, W, 3] display-referred, 0..1"""


@dataclass(frozen=True)
class Mesh:
    """Triangles in the coordinates of the model; seen from outside their corners go counterclockwise."""

    vertices: Array
    """[V, 3] in units of the model; float32, as files have it, of a surface that was found"""
    faces: Array
    """[F, 3] int, rows of ``vertices``"""
    colors: Array | None = None
    """[V, 3] display-referred, 0..1; None: not known"""
    texture: Texture | None = None
    """in place of ``colors``"""

    @property
    def to_unit(self) -> float:
        """A power of two that makes the mean side of a triangle about 1, for libraries with thresholds of their own,
        which are absolute; 1 where there is no side."""
        ends = self.vertices.astype(np.float64)[self.faces]  # [F, 3, 3]
        sides = np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2)
        return 2.0 ** -round(math.log2(sides.mean())) if sides.any() else 1.0

    def parts(self) -> Array:
        """[F] which connected part each face is in, counted from 0; parts that share a vertex are one."""
        a, b, c = self.faces.T
        edges = np.concatenate([a, b]), np.concatenate([b, c])
        n = len(self.vertices)
        graph = coo_array((np.ones(len(edges[0]), bool), edges), shape=(n, n))
        return connected_components(graph, directed=False)[1][a]

    def with_faces(self, keep: Array) -> Mesh:
        """The mesh of the faces ``keep`` [F] (bool), and the vertices that these have, in their order."""
        used, faces = np.unique(self.faces[keep], return_inverse=True)
        colors = None if self.colors is None else self.colors[used]
        texture = None if self.texture is None else replace(self.texture, uv=self.texture.uv[used])
        vertices, faces = self.vertices[used], faces.reshape(-1, 3)
        return replace(self, vertices=vertices, faces=faces, colors=colors, texture=texture)

    def without_crumbs(self, least: int, most_parts: int | None = None) -> Mesh:
        """The mesh without parts of fewer than ``least`` faces; if asked, with the largest ``most_parts`` alone."""
        if not len(self.faces):
            return self
        part = self.parts()
        sizes = np.bincount(part)
        kept = sizes >= least
        if most_parts is not None:
            kept &= np.isin(np.arange(len(sizes)), np.argsort(-sizes, kind="stable")[:most_parts])
        return self.with_faces(kept[part])
