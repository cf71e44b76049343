"""Blocks near the surfaces that views see; how fine these may be, by the views and by the memory."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..scene.splats import Array
from ..support.memory import available_memory
from ..support.settings import refuse
from ..support.wording import counted, file_size
from .blocks import VOXELS, BlockFinder, Blocks
from .surface_views import SurfaceViews, points_of

TRUNCATION = 4.0  # voxels, to either side of a surface
MOST_BLOCKS = 1 << 22  # beyond, sums have more entries than Dr.Jit can index
BYTES = 18  # of a voxel, while its distance becomes triangles
VOXELS_OF_PIXEL = 4  # more of them along what a pixel of the finest view shows, and the surface falls into crumbs


def seen_blocks(
    views: SurfaceViews, centre: Array, voxel: float, reach: float, is_asked: bool, tell: Callable[[], None]
) -> Blocks:
    """Blocks near the surfaces that views see within ``reach`` of ``centre``.

    A voxel that is much finer than the views becomes coarser, a whole number of times. Raises ``DataError`` where it
    ``is_asked`` for, and for more blocks than there is memory for.
    """
    if reach / voxel > 1 << 19:
        refuse("voxel", f"{voxel:g} is too small for a model that reaches {reach:g} far", "use a larger one")
    finder, finest = BlockFinder(centre, voxel, TRUNCATION * voxel), math.inf
    for camera, depth, _ in views:
        points = points_of(camera, depth)
        points = points[((points - centre) ** 2).sum(axis=1) <= reach**2]
        finder.add(points)
        require_room(finder.at_least, voxel)
        if len(points):
            finest = min(finest, float(np.median(camera.project(points)[1])) / max(camera.fx, camera.fy))
        tell()
    if voxel < (least := finest / VOXELS_OF_PIXEL) < math.inf:
        if is_asked:
            problem = f"{voxel:g} is finer than the views, whose pixels are {finest:.2g} wide at the surface"
            refuse("voxel", problem, f"use {least:.2g} or more, or larger views")
        finder = finder.coarser(math.ceil(least / voxel))
    blocks = finder.blocks()
    require_room(len(blocks.keys), blocks.voxel)
    return blocks


def require_room(n_blocks: int, voxel: float) -> None:
    """Raise ``DataError`` for more blocks than the memory can hold, or Dr.Jit index."""
    need = n_blocks * VOXELS * BYTES
    if n_blocks > MOST_BLOCKS or need > (available_memory() or need):
        problem = f"{voxel:g} makes {counted(n_blocks * VOXELS, 'voxel')} or more, of {file_size(need)} in memory"
        refuse("voxel", problem, "use a larger one, or a smaller --reach")
