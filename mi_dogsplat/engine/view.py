"""A view ready to be walked: primitives projected, laid out and listed tile by tile. What every walk takes."""

from __future__ import annotations

from dataclasses import dataclass

from .arrays import detached
from .geometry import Blocks, Grid, Lanes
from .options import RasterOptions, Settings
from .project import DeviceCamera, Projection, project
from .tables import Tables, pack
from .tiles import TileLists, tiles


@dataclass
class PreparedView:
    """The argument of the kernels in ``walks/``; without derivatives."""

    grid: Grid
    lanes: Lanes  # the grid's: Dr.Jit does not look for arrays there
    tables: Tables
    lists: TileLists
    settings: Settings


def prepare(params: dict, camera: DeviceCamera, options: RasterOptions, blocks: Blocks | None = None) -> PreparedView:
    """A view whose features are the colours of the primitives.

    Args:
        params: raw parameters as flat arrays, see ``project``.
        camera: the view and its size.
        options: specialisation of the kernels; ``depth`` and ``normal`` are not looked at.
        blocks: of pixels, one per lane; None: the backend's.
    """
    projection = _projection(params, camera, options)
    grid = Grid.of(camera.width, camera.height, blocks or Blocks.of_backend())
    return arrange(projection, projection.colors, grid, Settings.of(options, 3))


def prepare_both(
    params: dict, camera: DeviceCamera, options: RasterOptions, blocks: Blocks
) -> tuple[PreparedView, PreparedView]:
    """A view projected once and prepared twice, as by ``prepare``: with the backend's blocks, to be composited, and
    with ``blocks``, for a walk that needs its image."""
    projection = _projection(params, camera, options)
    grid, other = (Grid.of(camera.width, camera.height, b) for b in (Blocks.of_backend(), blocks))
    view = arrange(projection, projection.colors, other, Settings.of(options, 3))
    # tiles that overlap list more than blending needs, and are in the same places
    lists = view.lists if blocks.tiles_as(grid.blocks) else tiles(projection, grid, options.cutoffs)
    return PreparedView(grid, grid.lanes, view.tables, lists, view.settings), view


def arrange(
    projection: Projection, features: list, grid: Grid, settings: Settings, stop_depth=None
) -> PreparedView:
    """Lay out and list primitives that have been projected.

    Args:
        features: what is blended, [N] each, as many as ``settings`` says.
        stop_depth: [H*W], a primitive whose fourth feature, its depth, is larger is not blended into a pixel.
    """
    tables = pack(projection, features)
    tables.stop_depth = detached(stop_depth) if stop_depth is not None else None
    return PreparedView(grid, grid.lanes, tables, tiles(projection, grid, settings.cutoffs), settings)


def _projection(params: dict, camera: DeviceCamera, options: RasterOptions) -> Projection:
    return project(params, camera, sh_degree=options.sh_degree, antialiased=options.antialiased)
