"""A furnished room with walls all around, for panoramas and depths: scikit-image's photographs on all that is flat."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from skimage import data

LENGTH, WIDTH, HEIGHT = 6.0, 5.0, 2.8  # metres along x, y and z
PICTURES = ((data.astronaut, 1.6), (data.coffee, 2.2), (data.chelsea, 2.0), (data.rocket, 2.4))
"""What hangs on the four walls, and how wide it is."""
FURNITURE = ((1.7, 1.2, 0.45, 20.0), (-1.8, -1.3, 0.35, 50.0), (-1.9, 1.5, 0.6, -10.0), (1.9, -1.5, 0.25, 5.0))
"""Boxes: x, y, half of the edge, and degrees about the vertical."""


def closed_room() -> Any:
    """The floor is at z = 0, and the middle of it is the origin."""
    T = mi.ScalarTransform4f
    half = [LENGTH / 2, WIDTH / 2, HEIGHT / 2]
    floor, ceiling = T().scale([half[0], half[1], 1]), T().translate([0, 0, HEIGHT]).scale([half[0], half[1], -1])
    room: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "floor": {"type": "rectangle", "to_world": floor, "bsdf": _diffuse(data.gravel(), (1.0, 0.8, 0.6))},
        "ceiling": {"type": "rectangle", "to_world": ceiling, "bsdf": _diffuse(data.page(), (0.9, 0.9, 0.85))},
        "lamp": {
            "type": "rectangle",
            "to_world": T().translate([0, 0, HEIGHT - 0.01]).scale([1, 1, -1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 9.0}},
        },
    }
    tints = (1.0, 0.8, 0.6), (0.7, 1.0, 0.9), (0.9, 0.8, 1.0), (1.0, 0.95, 0.7)
    for k, (tint, (picture, width)) in enumerate(zip(tints, PICTURES, strict=True)):
        across, away = (half[0], half[1]) if k % 2 == 0 else (half[1], half[0])
        wall = T().rotate([0, 0, 1], 90 * k).translate([0, away, half[2]]).rotate([1, 0, 0], 90)
        bricks = _diffuse(data.brick(), tint)
        room[f"wall{k}"] = {"type": "rectangle", "to_world": wall.scale([across, half[2], 1]), "bsdf": bricks}
        pixels = picture()
        size = [width / 2, width / 2 * pixels.shape[0] / pixels.shape[1], 1]
        hung = wall.translate([0.3, 0.2, 0.02]).scale(size)
        room[f"picture{k}"] = {"type": "rectangle", "to_world": hung, "bsdf": _diffuse(pixels[::-1], (1, 1, 1))}
    cloths = data.grass(), data.stereo_motorcycle()[0], data.coins(), data.colorwheel()
    for k, ((x, y, edge, turn), cloth) in enumerate(zip(FURNITURE, cloths, strict=True)):
        pose = T().translate([x, y, edge]).rotate([0, 0, 1], turn).scale(edge)
        room[f"box{k}"] = {"type": "cube", "to_world": pose, "bsdf": _diffuse(cloth, (1.0, 0.9, 0.8))}
    return mi.load_dict(room)


def surfaces(room: Any) -> np.ndarray:
    """All that is flat in it: [Q, 3, 3] a corner, and the two edges of the rectangle that begin there."""
    found = []
    for shape in room.shapes():
        known: Any = mi.traverse(shape)
        if "vertex_positions" in known:  # a cube, of which each side has its own four vertices
            corners = known["vertex_positions"].numpy().reshape(-1, 4, 3)
            found.extend(np.stack([side[0], side[1] - side[0], side[3] - side[0]]) for side in corners)
        else:
            to_world = np.array(known["to_world"].matrix).reshape(4, 4)
            corner = to_world @ (-1, -1, 0, 1)
            found.append(np.stack([corner[:3], 2 * to_world[:3, 0], 2 * to_world[:3, 1]]))
    return np.stack(found).astype(np.float64)


def distances(points: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """[P] how far points [P, 3] are from the nearest of the ``surfaces`` [Q, 3, 3]."""
    nearest = np.full(len(points), np.inf)
    for corner, *edges in flat:
        away = points - corner
        for edge in edges:  # they are perpendicular to each other
            away = away - np.clip(away @ edge / (edge @ edge), 0, 1)[:, None] * edge
        nearest = np.minimum(nearest, np.linalg.norm(away, axis=1))
    return nearest


def _diffuse(pixels: np.ndarray, tint: tuple[float, float, float]) -> dict[str, Any]:
    """A material with this picture, uint8 [H, W] or [H, W, 3] in sRGB, times a colour; its first row is the lowest."""
    colours = (pixels[..., None] if pixels.ndim == 2 else pixels) / 255.0 * np.array(tint)
    bitmap = mi.Bitmap(np.rint(255 * colours).astype(np.uint8))
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "bitmap", "bitmap": bitmap}}}
