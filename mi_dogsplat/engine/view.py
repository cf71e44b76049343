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
    return arrange(projection, projection.colors, grid, options)


def prepare_both(
    params: dict, camera: DeviceCamera, options: RasterOptions, blocks: Blocks
) -> tuple[WalkableView, WalkableView]:
    """A view projected once and prepared twice, as by ``prepare``: with the backend's blocks, to be composited, and
    with ``blocks``, for a walk that needs its image."""
    projection = _projection(params, camera, options)
    grid, other = (Grid.of(camera.width, camera.height, b) for b in (Blocks.of_backend(), blocks))
    view = arrange(projection, projection.colors, other, options)
    if not blocks.tiles_as(grid.blocks):
        return listed(projection, view.tables, grid, view.settings, options.isect_memory), view
    # tiles that overlap list more than blending needs, and they and their lanes are in the same places
    return replace(view, grid=grid), view


def arrange(
    projection: Projection, features: list, grid: Grid, options: RasterOptions, stop_depth=None
) -> WalkableView:
    """Lay out and list primitives that have been projected.

    Args:
        features: what is blended, [N] each; the colours first, if they vary.
        options: specialisation of the kernels, and memory; ``depth`` and ``normal`` are not looked at.
        stop_depth: [H*W], a primitive whose fourth feature, its depth, is larger is not blended into a pixel.
    """
    settings = settings_of(options, len(features), projection)
    tables = pack(projection, features, settings)
    tables.stop_depth = detached(stop_depth) if stop_depth is not None else None
    return listed(projection, tables, grid, settings, options.isect_memory)


def settings_of(options: RasterOptions, n_features: int, projection: Projection) -> Settings:
    """What the kernels are specialised to: by the options, and by what varies over the primitives that there are."""
    return Settings(
        n_features,
        options.cutoffs,
        options.negative_transmittance,
        options.patch,
        slopes=projection.slopes is not None,
        curvatures=projection.curvatures is not None,
        cuts=projection.planes,
    )


def _projection(params: dict, camera: DeviceCamera, options: RasterOptions) -> Projection:
    if dr.width(params["logit_opacities"]) == 0:
        raise ValueError("prepare: there is no primitive, so there is no view to walk")
    return projected(params, camera, sh_degree=options.sh_degree, antialiased=options.antialiased)
