"""Colours of the vertices of a mesh, from the views that see them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..scene.splats import Array
from .surface_views import SurfaceViews

UNSEEN = 0.5  # grey


def vertex_colors(vertices: Array, views: SurfaceViews, tolerance: float, show: Callable[[], None]) -> Array:
    """[V, 3] display-referred, 0..1: the mean over the views in which a vertex is on the surface of its pixel.

    Args:
        vertices: [V, 3] world positions.
        tolerance: by how much farther or nearer than that surface a vertex may be, world units.
        show: called after each view.
    """
    sums, counts = np.zeros((len(vertices), 3)), np.zeros(len(vertices))
    for camera, depth, color in views:
        pixels, z = camera.project(vertices)
        rows = np.flatnonzero((z > views.near) & ((pixels >= 0) & (pixels < depth.shape[::-1])).all(axis=1))
        column, row = pixels[rows].astype(int).T
        there = depth[row, column]
        seen = (there > 0) & (abs(there - z[rows]) <= tolerance)
        sums[rows[seen]] += color[row[seen], column[seen]]
        counts[rows[seen]] += 1
        show()
    mean = sums / np.maximum(counts, 1)[:, None]
    return np.where(counts[:, None] > 0, mean, UNSEEN)
