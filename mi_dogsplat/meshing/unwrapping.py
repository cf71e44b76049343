"""A surface laid flat: cut into charts that lie side by side in a picture, by the library xatlas."""

from __future__ import annotations

import numpy as np
import xatlas

from ..scene.splats import Array
from .mesh import Mesh

GAP = 2  # pixels between charts, so that a picture that is shown smaller mixes none


def unwrapped(mesh: Mesh, size: int) -> tuple[Mesh, Array]:
    """The mesh, and for each vertex its place [V, 2] in a picture of ``size`` x ``size`` pixels, as in ``Texture``.

    A vertex on the border of several charts becomes as many. Colours of vertices are gone.
    """
    centre = mesh.vertices.mean(axis=0, dtype=np.float64)  # far from the origin float32 loses their shape
    shape = (mesh.vertices - centre) * mesh.to_unit  # below some area it takes triangles for none
    atlas, packing = xatlas.Atlas(), xatlas.PackOptions()
    packing.resolution, packing.padding, packing.bilinear = size, GAP, True
    atlas.add_mesh(shape.astype(np.float32), mesh.faces.astype(np.uint32))
    atlas.generate(xatlas.ChartOptions(), packing)
    origins, faces, uv = atlas[0]
    return Mesh(mesh.vertices[origins], faces.astype(np.int64)), uv.astype(np.float64)
