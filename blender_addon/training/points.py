"""Points to start a training from: what random pixels of the training views see, in the colours of their pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from ..files.srgb import encoded
from ..objects.attributes import is_splats
from ..objects.working_space import from_working
from .data_set import Frame

MOST = 20_000
RAYS = 2  # cast for each point, as some pixels see nothing
SOLID = 0.5  # alpha of a pixel that shows a surface
PAST = 1e-4  # of the way: where a ray goes on behind what cameras do not see
LAYERS = 16  # of such things, that a ray goes through


def seen_points(
    context: bpy.types.Context,
    frames: Sequence[Frame],
    path: Callable[[Frame], Path],
    unseen: set[bpy.types.Object],
) -> tuple[np.ndarray, np.ndarray]:
    """(positions [P, 3] in the world, sRGB colours [P, 3]); ``path`` has the picture of a frame.

    Rays go through ``unseen`` objects and those that renders hide.
    """
    depsgraph, found = context.evaluated_depsgraph_get(), [(np.zeros((0, 3)), np.zeros((0, 3)))]
    each = math.ceil(RAYS * MOST / max(len(frames), 1))
    linear = False

    def is_seen(obj: bpy.types.Object) -> bool:
        return obj not in unseen and not obj.hide_render and not is_splats(obj)

    for i, frame in enumerate(frames):
        picture, linear = _read(path(frame))
        solid = np.argwhere(picture[..., 3] > SOLID)  # [S, 2] row, column
        pixels = np.random.default_rng(i).permutation(solid)[:each]
        hits = [_first(context.scene, depsgraph, *ray, is_seen) for ray in _rays(frame, pixels)]
        on = np.array([hit is not None for hit in hits], bool)
        positions = np.array([hit for hit in hits if hit is not None]).reshape(-1, 3)
        seen = picture[pixels[on, 0], pixels[on, 1]]
        found.append((positions, seen[:, :3] / seen[:, 3:] if linear else seen[:, :3]))
    positions, colors = (np.concatenate(values) for values in zip(*found, strict=True))
    kept = np.random.default_rng(0).permutation(len(positions))[:MOST]
    return positions[kept], _displayed(colors[kept]) if linear else colors[kept]


def _rays(frame: Frame, pixels: np.ndarray) -> list[tuple[Vector, Vector]]:
    """(start, direction) through the centres of pixels [K, 2]."""
    pose = np.array(frame["transform_matrix"])
    x = (pixels[:, 1] + 0.5 - frame["cx"]) / frame["fl_x"]
    y = (pixels[:, 0] + 0.5 - frame["cy"]) / frame["fl_y"]
    ways = np.stack([x, -y, -np.ones(len(pixels))], axis=1) @ pose[:3, :3].T
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return [(Vector(pose[:3, 3]), Vector(way)) for way in ways]


def _first(scene: bpy.types.Scene, depsgraph: Any, start: Vector, way: Vector, is_seen: Callable) -> Vector | None:
    """The first surface that cameras see."""
    for _ in range(LAYERS):
        hit, place, _, _, obj, _ = scene.ray_cast(depsgraph, start, way)
        if not hit:
            return None
        if is_seen(obj.original):
            return place
        start = place + PAST * max((place - start).length, PAST) * way
    return None


def _read(path: Path) -> tuple[np.ndarray, bool]:
    """([H, W, 4] from the top, whether it is linear radiance, which is premultiplied)."""
    image = bpy.data.images.load(str(path))
    try:
        width, height = image.size
        pixels = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
        pixels = pixels.reshape(height, width, 4)[::-1]
        if image.is_float:
            pixels[..., :3] = from_working(pixels[..., :3])
        return pixels, image.is_float
    finally:
        bpy.data.images.remove(image)


def _displayed(radiance: np.ndarray) -> np.ndarray:
    """What a screen shows of it; white is twice the 95th percentile of the luminances."""
    light = radiance @ (0.2126, 0.7152, 0.0722)
    white = 2 * np.percentile(light, 95) if len(light) and light.max() > 0 else 1.0
    return encoded(np.clip(radiance / white, 0, 1))
