"""From raw parameters to a view ready to be walked: primitives projected, laid out and listed tile by tile."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr

from .arrays import detached
from .bands import WalkableView, listed
from .device_camera import DeviceCamera
from .geometry import Blocks, Grid
from .options import RasterOptions, Settings
from .project import Projection
from .projected import projected
from .tables import pack


def prepare(params: dict, camera: DeviceCamera, options: RasterOptions, blocks: Blocks | None = None) -> WalkableView:
    """A view whose features are the colours of the primitives.

    Args:
        params: raw parameters as flat arrays, see ``project``.
        camera: the view and its size.
        options: specialisation of the kernels; ``depth`` and ``normal`` are not looked at.
        blocks: of pixels, one per lane; None: the backend's.

    Raises ``ValueError`` if there is no primitive: ``rasterize`` draws the background of none.
    """
    projection = _projection(params, camera, options)
    grid = Grid.of(camera.width, camera.height, blocks or Blocks.of_backend())
    return arrange(projection, projection.colors, grid, Settings.of(options, 3), isect_memory=options.isect_memory)


def prepare_both(
    params: dict, camera: DeviceCamera, options: RasterOptions, blocks: Blocks
) -> tuple[WalkableView, WalkableView]:
    """A view projected once and prepared twice, as by ``prepare``: with the backend's blocks, to be composited, and
    with ``blocks``, for a walk that needs its image."""
    projection = _projection(params, camera, options)
    settings = Settings.of(options, 3)
    grid, other = (Grid.of(camera.width, camera.height, b) for b in (Blocks.of_backend(), blocks))
    view = arrange(projection, projection.colors, other, settings, isect_memory=options.isect_memory)
    if not blocks.tiles_as(grid.blocks):
        return listed(projection, view.tables, grid, view.settings, options.isect_memory), view
    # tiles that overlap list more than blending needs, and they and their lanes are in the same places
    return replace(view, grid=grid), view


def arrange(
    projection: Projection,
    features: list,
    grid: Grid,
    settings: Settings,
    stop_depth=None,
    isect_memory: float | None = None,
) -> WalkableView:
    """Lay out and list primitives that have been projected.

    Args:
        features: what is blended, [N] each, as many as ``settings`` says; the colours first, if they vary.
        settings: whatever they say of slopes, curvatures and cuts, it is the projection that has some or none.
        stop_depth: [H*W], a primitive whose fourth feature, its depth, is larger is not blended into a pixel.
        isect_memory: as in ``RasterOptions``.
    """
    settings = settings_of(settings, projection)
    tables = pack(projection, features, settings)
    tables.stop_depth = detached(stop_depth) if stop_depth is not None else None
    return listed(projection, tables, grid, settings, isect_memory)


def settings_of(settings: Settings, projection: Projection) -> Settings:
    """Of a projection, with what varies over its primitives."""
    slopes, curvatures = projection.slopes is not None, projection.curvatures is not None
    return replace(settings, slopes=slopes, curvatures=curvatures, cuts=projection.planes)


def _projection(params: dict, camera: DeviceCamera, options: RasterOptions) -> Projection:
    if dr.width(params["logit_opacities"]) == 0:
        raise ValueError("prepare: there is no primitive, so there is no view to walk")
    return projected(params, camera, sh_degree=options.sh_degree, antialiased=options.antialiased)
