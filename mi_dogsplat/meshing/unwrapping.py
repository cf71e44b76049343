"""A surface laid flat: cut into charts that lie side by side in a picture, by the library xatlas."""

from __future__ import annotations

import math

import numpy as np

from ..scene.splats import Array
from .mesh import Mesh

GAP = 2  # pixels between charts, so that a picture that is shown smaller mixes none


def unwrapped(mesh: Mesh, size: int) -> tuple[Mesh, Array]:
    """The mesh, and for each vertex its place [V, 2] in a picture of ``size`` x ``size`` pixels, as in ``Texture``.

    A vertex on the border of several charts becomes as many. Colours of vertices are gone.
    """
    import xatlas

    centre = mesh.vertices.mean(axis=0, dtype=np.float64)  # far from the origin float32 loses their shape
    shape = (mesh.vertices - centre) * _enlargement(mesh)
    atlas, packing = xatlas.Atlas(), xatlas.PackOptions()
    packing.resolution, packing.padding, packing.bilinear = size, GAP, True
    atlas.add_mesh(shape.astype(np.float32), mesh.faces.astype(np.uint32))
    atlas.generate(xatlas.ChartOptions(), packing)
    origins, faces, uv = atlas[0]
    return Mesh(mesh.vertices[origins], faces.astype(np.int64)), uv.astype(np.float64)


def _enlargement(mesh: Mesh) -> float:
    """A power of two that makes the mean side of a triangle about 1: the library takes triangles below some area, of
    whatever unit, for none."""
    ends = mesh.vertices.astype(np.float64)[mesh.faces]  # [F, 3, 3]
    mean = float(np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2).mean())
    return 2.0 ** -round(math.log2(mean)) if mean > 0 else 1.0
