"""The surface that cameras see of a model: views, blocks, distances, triangles, fewer triangles, colours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..render.framing import robust_sphere
from ..scene.cameras import Camera
from ..scene.drawing import DrawnAs
from ..scene.splats import Array, Splats
from ..support.settings import refuse
from ..support.wording import counted
from .blocks import Blocks
from .fusion import Fusion
from .marching import zero_surface
from .mesh import Mesh
from .mesh_config import DEPTHS, MeshConfig
from .seen_blocks import TRUNCATION, seen_blocks
from .simplification import simplified
from .surface_colors import UNSEEN, surface_colors
from .surface_views import SurfaceViews
from .texture import require_room_for, textured

VOXELS_OF_RADIUS = 128
STEPS_OF_VOXEL = 4  # at least: of the positions that float32, as models and meshes have it, tells apart
LEAST_VIEWS = 2  # that tell a voxel, or all where there are fewer


def surface_of(
    splats: Splats,
    cameras: list[Camera],
    drawn: DrawnAs,
    config: MeshConfig = MeshConfig(),
    show: Callable[[int, int], None] | None = None,
    photographs: Callable[[int, Array], Array] | None = None,
) -> tuple[Mesh, float]:
    """The surface that cameras see of a model, and the voxel it was looked for with, world units.

    Args:
        cameras: V >= 1 of them.
        drawn: how the model is drawn.
        config: its ``voxel``, ``reach``, ``min_faces``, ``connected``, ``faces``, ``texture`` and ``depth``.
        show: as in ``make_mesh``.
        photographs: colours of a view by its number and the model's there (``photograph_colors.py``); None: the latter.

    Raises ``DataError`` where there would be too many voxels or pixels, or no part that is large enough.
    """
    if config.texture is not None:
        require_room_for(config.texture)
    done = 0

    def tell() -> None:
        nonlocal done
        done += 1
        if show:
            show(done, 3 * len(cameras))

    centre, radius = robust_sphere(splats)
    voxel = voxel_of(config, centre, radius)
    views = SurfaceViews.of(splats, cameras, drawn, photographs, DEPTHS[config.depth])
    blocks = seen_blocks(views, centre, voxel, config.reach * radius, config.voxel is not None, tell)
    voxel = blocks.voxel
    mesh = zero_surface(blocks, fused(views, blocks, tell))
    kept = mesh.without_crumbs(config.min_faces, config.connected)
    if len(mesh.faces) > len(kept.faces) == 0:
        most = counted(int(np.bincount(mesh.parts()).max()), "triangle")
        problem = f"{config.min_faces} is too many: no part has more than {most}"
        refuse("min_faces", problem, "use fewer, or a smaller --voxel")
    if config.texture is not None and config.faces is not None:
        few = simplified(kept, config.faces)
        return textured(few, config.texture, views, TRUNCATION * voxel, tell), voxel
    colors = surface_colors(kept.vertices, views, TRUNCATION * voxel, tell)
    kept = replace(kept, colors=np.where(np.isfinite(colors), colors, UNSEEN))
    return kept if config.faces is None else simplified(kept, config.faces), voxel


def voxel_of(config: MeshConfig, centre: Array, radius: float) -> float:
    """The voxel of a model, world units. Raises ``DataError`` for one finer than positions in float32 are there."""
    step = float(np.spacing(np.float32(np.abs(centre).max() + radius)))
    if config.voxel is None:
        return max(radius / VOXELS_OF_RADIUS, STEPS_OF_VOXEL * step)
    if config.voxel < STEPS_OF_VOXEL * step:
        problem = f"{config.voxel:g} is too small: positions in float32 have steps of {step:.2g} where the model is"
        refuse("voxel", problem, f"use {STEPS_OF_VOXEL * step:.2g} or more")
    return config.voxel


def fused(views: SurfaceViews, blocks: Blocks, tell: Callable[[], None]) -> Array:
    """[B, SIDE, SIDE, SIDE] what all views say of the distances in blocks; NaN where too few see anything."""
    fusion = Fusion(blocks, TRUNCATION * blocks.voxel)
    for camera, depth, _ in views:
        fusion.add(camera, depth, views.near)
        tell()
    return fusion.distances(min(LEAST_VIEWS, len(views.cameras)))
