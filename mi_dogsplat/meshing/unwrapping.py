"""A surface laid flat: cut into charts that lie side by side in a picture, by the library xatlas."""

from __future__ import annotations

import numpy as np

from .mesh import Mesh, Texture

GAP = 2  # pixels between charts, so that a picture that is shown smaller mixes none


def unwrapped(mesh: Mesh, size: int) -> Mesh:
    """The mesh with a place in a picture of ``size`` x ``size`` pixels for each vertex, and nothing painted there yet.

    A vertex on the border of several charts becomes as many. Colours of vertices are gone.
    """
    import xatlas

    centre = mesh.vertices.mean(axis=0, dtype=np.float64)  # far from the origin float32 loses their shape
    atlas, packing = xatlas.Atlas(), xatlas.PackOptions()
    packing.resolution, packing.padding, packing.bilinear = size, GAP, True
    atlas.add_mesh((mesh.vertices - centre).astype(np.float32), mesh.faces.astype(np.uint32))
    atlas.generate(xatlas.ChartOptions(), packing)
    origins, faces, uv = atlas[0]
    texture = Texture(uv.astype(np.float64), np.zeros((size, size, 3), np.float32))
    return Mesh(mesh.vertices[origins], faces.astype(np.int64), texture=texture)
