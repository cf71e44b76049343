"""The colours of a surface as a picture, so that few triangles have many of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

from ..scene.splats import Array
from .mesh import Mesh
from .surface_colors import UNSEEN, surface_colors
from .surface_views import SurfaceViews
from .texels import texels_of
from .unwrapping import unwrapped


def textured(mesh: Mesh, size: int, views: SurfaceViews, tolerance: float, show: Callable[[], None]) -> Mesh:
    """The mesh with a texture of ``size`` x ``size`` pixels; ``tolerance``, ``show``: see ``surface_colors``.

    A pixel that no view sees has the colour of the nearest point of the surface that one sees. What lies between the
    charts has the colour of the nearest pixel in one, so that nothing else is mixed in at their borders.
    """
    if not len(mesh.faces):
        return mesh
    flat = unwrapped(mesh, size)
    assert flat.texture is not None
    texels = texels_of(flat)
    colors = surface_colors(texels.points, views, tolerance, show, texels.normals)
    seen = np.isfinite(colors[:, 0])
    if seen.any():
        colors[~seen] = colors[seen][cKDTree(texels.points[seen]).query(texels.points[~seen])[1]]
    else:
        colors[:] = UNSEEN
    pixels = np.full((size, size, 3), np.nan, np.float32)
    pixels[texels.row, texels.column] = colors
    return replace(flat, texture=replace(flat.texture, pixels=_filled(pixels)))


def _filled(pixels: Array) -> Array:
    """A picture [H, W, 3] in which NaN has become the nearest colour."""
    empty = np.isnan(pixels[..., 0])
    if empty.all():
        return np.full_like(pixels, UNSEEN)
    nearest = np.asarray(distance_transform_edt(empty, return_distances=False, return_indices=True))
    return pixels[tuple(nearest)]
