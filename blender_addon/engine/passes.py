"""A picture of the package as the passes of a render layer."""

from __future__ import annotations

import json
from typing import Any

import bpy
import numpy as np

from ..files.light import Light
from ..files.srgb import decoded, encoded
from ..objects.working_space import from_working, to_working
from ..scene.world import one_color
from .cryptomatte import float_of, key_of, manifest
from .order import Order

NOT_HIT = 1e10  # depth where nothing is, as in Cycles
ALPHA = "Alpha"
OBJECT_INDEX = "Object Index" if bpy.app.version >= (5, 0) else "IndexOB"
MATTE = "CryptoObject"  # and two digits: two objects in each
# By the name in Blender: channels, their names, kind, and what the package calls what it is made from
DATA = {
    "Depth": (1, "Z", "VALUE", "depth"),
    "Normal": (3, "XYZ", "VECTOR", "normal"),
    OBJECT_INDEX: (1, "X", "VALUE", "object"),
    f"{MATTE}00": (4, "RGBA", "COLOR", "matte"),
    f"{MATTE}01": (4, "RGBA", "COLOR", "matte"),
}
SETTINGS = {
    "depth": "use_pass_z",
    "normal": "use_pass_normal",
    "object": "use_pass_object_index",
    "matte": "use_pass_cryptomatte_object",
}


def wanted(layer: bpy.types.ViewLayer) -> list[str]:
    """Passes of the package that a view layer asks for."""
    return [name for name, setting in SETTINGS.items() if getattr(layer, setting)]


def offered(layer: bpy.types.ViewLayer) -> dict[str, tuple[int, str, str, str]]:
    """The passes of Blender beside Combined, as in ``DATA``."""
    names = wanted(layer)
    return {ALPHA: (1, "A", "VALUE", "alpha")} | {name: row for name, row in DATA.items() if row[3] in names}


def values(order: Order, picture: dict[str, np.ndarray], scene: bpy.types.Scene) -> dict[str, np.ndarray]:
    """[H, W, C] of every pass that the picture has, rows from the top."""
    picture = {name: _as_high(array, order.camera.height) for name, array in picture.items()}
    alpha = picture["alpha"]
    found = {"Combined": _combined(order, picture, scene), ALPHA: alpha[..., None]}
    if "depth" in picture:
        depth = picture["depth"]
        found["Depth"] = np.where(np.isfinite(depth) & (alpha > 0), depth, NOT_HIT)[..., None]
    if "normal" in picture:
        found["Normal"] = picture["normal"]
    if "object" in picture:
        of_object = [of.index for of in order.objects] + [0]  # -1 is the last
        found[OBJECT_INDEX] = np.array(of_object, np.float32)[picture["object"]][..., None]
    if "matte" in picture:
        hashes = np.array([float_of(of.name) for of in order.objects] + [0.0], np.float32)
        matte = picture["matte"]  # [H, W, 4, 2]
        ranks = np.stack([hashes[matte[..., 0].astype(int)], matte[..., 1]], -1).reshape(*matte.shape[:2], 8)
        found |= {f"{MATTE}00": ranks[..., :4], f"{MATTE}01": ranks[..., 4:]}
    return found


def matte_metadata(layer: str, order: Order) -> dict[str, str]:
    """What the Cryptomatte of an OpenEXR file says about itself."""
    name = f"{layer}.{MATTE}"
    said = {"name": name, "hash": "MurmurHash3_32", "conversion": "uint32_to_float32"}
    said["manifest"] = json.dumps(manifest([of.name for of in order.objects]))
    return {f"cryptomatte/{key_of(name)}/{word}": text for word, text in said.items()}


def world_color(world: bpy.types.World | None) -> np.ndarray:
    """Linear colour [3] behind splats alone; where the nodes of the world have not just one, that of viewports."""
    color = one_color(world)
    return np.array(world.color) if world and color is None else color


def background(scene: bpy.types.Scene, light: Light) -> np.ndarray:
    """[3] behind splats alone, as they are blended: radiance where theirs is, sRGB values, or the values of a file."""
    behind = world_color(scene.world)
    if light.linear:
        return from_working(behind)
    return encoded(from_working(behind)) if scene.dogsplat_colors == "LINEAR" else behind


def _combined(order: Order, picture: dict[str, np.ndarray], scene: bpy.types.Scene) -> np.ndarray:
    color, alpha = picture["color"], picture["alpha"][..., None]
    hole = picture["hole"][..., None] if "hole" in picture else 0.0  # of holdouts, behind which nothing shows
    if order.whole:
        return np.concatenate([to_working(color), alpha], axis=2)
    linear = scene.dogsplat_colors == "LINEAR"
    if not scene.render.film_transparent:
        color = color + (1 - alpha - hole) * background(scene, order.light)
        alpha = np.ones_like(alpha) - hole
    elif linear and not order.light.linear:
        color = np.minimum(color, np.maximum(alpha, 0))  # no brighter than white, where lobes take more from alpha
    if order.light.linear:
        shown = to_working(color) if linear else np.clip(encoded(color / order.light.white), 0, 1)
    else:
        shown = to_working(_radiance(color, alpha)) if linear else color
    return np.concatenate([shown, alpha], axis=2)


def _radiance(color: np.ndarray, share: Any) -> np.ndarray:
    """Linear colours of sRGB values that cover this share of a pixel, by their mean."""
    return share * decoded(color / np.where(share > 1e-6, share, 1.0))


def _as_high(array: Any, height: int) -> np.ndarray:
    """With so many rows: colours between two rows are mixed, numbers of objects and depths are not."""
    rows = len(array)
    if rows == height:
        return array
    place = np.clip((np.arange(height) + 0.5) * rows / height - 0.5, 0, rows - 1)
    if array.ndim == 4 or array.dtype.kind == "i" or not np.isfinite(array).all():
        return array[np.round(place).astype(int)]
    low = np.floor(place).astype(int)
    share = (place - low).reshape(-1, *[1] * (array.ndim - 1))
    return (1 - share) * array[low] + share * array[np.minimum(low + 1, rows - 1)]
