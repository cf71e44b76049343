"""A triangle mesh of a model's surface; behind ``dogsplat mesh``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..datasets import load_dataset
from ..export.refine import look_from_near
from ..formats.read import read_source
from ..render.framing import robust_sphere
from ..render.picture_options import PictureOptions
from ..render.vantages import vantage_cameras
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs, drawn_as
from ..scene.splats import Array, Splats
from ..support.errors import DataError
from ..support.memory import available_memory
from ..support.settings import refuse
from ..support.variants import require_arrays
from ..support.wording import counted, file_size
from .blocks import VOXELS, BlockFinder, Blocks
from .fusion import Fusion
from .marching import zero_surface
from .mesh import Mesh
from .mesh_config import MeshConfig
from .mesh_files import writer_of
from .surface_views import SurfaceViews, points_of
from .vertex_colors import vertex_colors

VOXELS_OF_RADIUS = 128
STEPS_OF_VOXEL = 4  # at least: of the positions that float32, as models and meshes have it, tells apart
TRUNCATION = 4.0  # voxels, to either side of a surface
MOST_BLOCKS = 1 << 22  # beyond, sums have more entries than Dr.Jit can index
BYTES = 18  # of a voxel, while its distance becomes triangles
VOXELS_OF_PIXEL = 4  # more of them along what a pixel of the finest view shows, and the surface falls into crumbs
LEAST_VIEWS = 2  # that tell a voxel, or all where there are fewer


@dataclass(frozen=True)
class Meshed:
    """What came of it."""

    n_faces: int
    n_views: int
    voxel: float
    """world units"""


def make_mesh(
    model: str | Path,
    out: str | Path,
    config: MeshConfig = MeshConfig(),
    data: str | Path | None = None,
    options: PictureOptions = PictureOptions(),
    show: Callable[[int, int], None] | None = None,
) -> Meshed:
    """Write the surface of a model as triangles with colours, in the coordinates of the model.

    Args:
        model: the model, of any format.
        out: the .ply or .obj to write.
        config: how.
        data: a data set whose training views are fused; without one cameras are placed around and inside.
        options: how pictures are drawn; what they do not say, the model's file does.
        show: called with the views that are done, each of which is looked at three times, and how many there are.

    Needs a Mitsuba variant. Raises ``DataError``.
    """
    require_arrays()
    model, out = Path(model), Path(out)
    write = writer_of(out)
    config.require_use(own_views=bool(data))
    options.require_use(images=bool(data), pictures=True)
    read = read_source(model, out, "mesh")
    splats, drawn = read.splats, drawn_as(options.drawing, read.drawing)
    options.require_for(drawn.linear)
    if data:
        cameras = [view.camera for view in load_dataset(data, options.shrink).train]
    else:
        cameras = vantage_cameras(splats, config.views, config.size, 0, config.inside, read.drawing.up)
        if options.near_clip is None:
            drawn = look_from_near(splats, drawn).drawn
    mesh, voxel = surface_of(splats, cameras, drawn, config, show)
    if not len(mesh.faces):
        problem = "no surface is seen that hides half of what is behind it"
        raise DataError(model, problem, "use a smaller --voxel or --near-clip, a larger --reach, or other views")
    write(out, mesh)
    return Meshed(len(mesh.faces), len(cameras), voxel)


def surface_of(
    splats: Splats,
    cameras: list[Camera],
    drawn: DrawnAs,
    config: MeshConfig = MeshConfig(),
    show: Callable[[int, int], None] | None = None,
) -> tuple[Mesh, float]:
    """The surface that cameras see of a model, and the voxel it was looked for with, world units.

    Args:
        cameras: V >= 1 of them.
        drawn: how the model is drawn.
        config: its ``voxel``, ``reach``, ``min_faces`` and ``connected``.
        show: as in ``make_mesh``.

    Raises ``DataError`` where there would be too many voxels, or no part that is large enough.
    """
    done = 0

    def tell() -> None:
        nonlocal done
        done += 1
        if show:
            show(done, 3 * len(cameras))

    centre, radius = robust_sphere(splats)
    voxel = voxel_of(config, centre, radius)
    views = SurfaceViews.of(splats, cameras, drawn)
    blocks = seen_blocks(views, centre, voxel, config.reach * radius, config.voxel is not None, tell)
    voxel = blocks.voxel
    mesh = zero_surface(blocks, fused(views, blocks, tell))
    kept = mesh.without_crumbs(config.min_faces, config.connected)
    if len(mesh.faces) > len(kept.faces) == 0:
        most = counted(int(np.bincount(mesh.parts()).max()), "triangle")
        problem = f"{config.min_faces} is too many: no part has more than {most}"
        refuse("min_faces", problem, "use fewer, or a smaller --voxel")
    return replace(kept, colors=vertex_colors(kept.vertices, views, TRUNCATION * voxel, tell)), voxel


def voxel_of(config: MeshConfig, centre: Array, radius: float) -> float:
    """The voxel of a model, world units. Raises ``DataError`` for one finer than positions in float32 are there."""
    step = float(np.spacing(np.float32(np.abs(centre).max() + radius)))
    if config.voxel is None:
        return max(radius / VOXELS_OF_RADIUS, STEPS_OF_VOXEL * step)
    if config.voxel < STEPS_OF_VOXEL * step:
        problem = f"{config.voxel:g} is too small: positions in float32 have steps of {step:.2g} where the model is"
        refuse("voxel", problem, f"use {STEPS_OF_VOXEL * step:.2g} or more")
    return config.voxel


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


def fused(views: SurfaceViews, blocks: Blocks, tell: Callable[[], None]) -> Array:
    """[B, SIDE, SIDE, SIDE] what all views say of the distances in blocks; NaN where too few see anything."""
    fusion = Fusion(blocks, TRUNCATION * blocks.voxel)
    for camera, depth, _ in views:
        fusion.add(camera, depth, views.near)
        tell()
    return fusion.distances(min(LEAST_VIEWS, len(views.cameras)))


def require_room(n_blocks: int, voxel: float) -> None:
    """Raise ``DataError`` for more blocks than the memory can hold, or Dr.Jit index."""
    need = n_blocks * VOXELS * BYTES
    if n_blocks > MOST_BLOCKS or need > (available_memory() or need):
        problem = f"{voxel:g} makes {counted(n_blocks * VOXELS, 'voxel')} or more, of {file_size(need)} in memory"
        refuse("voxel", problem, "use a larger one, or a smaller --reach")
