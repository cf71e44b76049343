"""The colours of a surface as a picture, so that few triangles have many of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

from ..scene.splats import Array
from ..support.memory import available_memory
from ..support.settings import refuse
from ..support.wording import file_size
from .mesh import Mesh, Texture
from .surface_colors import UNSEEN, surface_colors
from .surface_views import SurfaceViews
from .texels import Texels, texels_of
from .unwrapping import unwrapped

PLACES = 200_000  # among which the nearest is looked for
BYTES = 240  # of a pixel, while it is painted


def textured(mesh: Mesh, size: int, views: SurfaceViews, tolerance: float, show: Callable[[], None]) -> Mesh:
    """The mesh with a texture of ``size`` x ``size`` pixels; ``tolerance``, ``show``: see ``surface_colors``.

    A pixel that no view sees has the colour of the nearest one in its chart that some view sees, or where there is none
    so near, colours of the nearest places in space. What lies between the charts has the colour of the nearest pixel in
    one, so that nothing else is mixed in at their borders.
    """
    if not len(mesh.faces):
        return mesh
    flat, uv = unwrapped(mesh, size)
    texels = texels_of(flat, uv, size)
    points = texels.between(flat.vertices)
    colors = surface_colors(points, views, tolerance, show, texels.normals())
    seen = np.isfinite(colors[:, 0])
    if not seen.any():
        return replace(flat, texture=Texture(uv, np.full((size, size, 3), UNSEEN, np.float32)))
    colors[~seen] = _from_afar(texels, points[seen], colors[seen])[~seen]
    pixels, charts = np.zeros((size, size, 3), np.float32), np.full((size, size), -1)
    pixels[texels.row, texels.column] = colors
    charts[texels.row, texels.column] = flat.parts()[texels.face]
    was_seen = np.zeros((size, size), bool)
    was_seen[texels.row[seen], texels.column[seen]] = True
    row, column = _nearest(was_seen)
    in_chart = ~was_seen & (charts >= 0) & (charts[row, column] == charts)
    pixels[in_chart] = pixels[row[in_chart], column[in_chart]]
    return replace(flat, texture=Texture(uv, pixels[_nearest(charts >= 0)]))


def require_room_for(size: int) -> None:
    """Raise ``DataError`` for a texture that the memory cannot hold while it is painted."""
    need = size * size * BYTES
    if need > (available_memory() or need):
        refuse("texture", f"{size} takes {file_size(need)} of memory while it is painted", "use fewer pixels")


def _from_afar(texels: Texels, points: Array, colors: Array) -> Array:
    """[T, 3] between colours at the vertices, each of which is that of the nearest of the ``points`` [P, 3]."""
    some = slice(None, None, 1 + len(points) // PLACES)
    nearest = cKDTree(points[some]).query(texels.mesh.vertices)[1]
    return texels.between(colors[some][nearest])


def _nearest(there: Array) -> tuple[Array, Array]:
    """Row and column [H, W] of the pixel nearest to each among those that are ``there`` [H, W]; one at least is."""
    row, column = np.asarray(distance_transform_edt(~there, return_distances=False, return_indices=True))
    return row, column
