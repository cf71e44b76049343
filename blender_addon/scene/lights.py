"""Lights with Blender's units.

Of a power P in watts, as Cycles takes it: a point and the axis of a spot have the intensity P / (4 π), a sphere of
radius r the radiance P / (4 π² r²), an area A the radiance P / (π A) on its front. The strength of a sun is its
irradiance. Where *Normalize* is off, which newer Blenders have, P / π is the radiance of spheres and areas, whatever
their size, and the strength of a sun is its radiance.
"""

from __future__ import annotations

import math

import bpy
import numpy as np

from ..objects.working_space import from_working
from .export import Export, Plugin, matrix, rgb
from .images import write_gray
from .sockets import Reader, active_tree, output_of

LOOKING = np.diag([1.0, -1.0, -1.0, 1.0])  # lights of Blender shine along -z, those of Mitsuba along z
SHARP_SUN = math.radians(1.0)  # angle below which a sun has no size
FAR = 1e3  # of the size of the scene: the distance of a sun that has one
WIDEST = math.radians(85.0)  # half the cone of a spot
FALLOFF_PIXELS = 256
NOTHING: Plugin = {"type": "null"}  # what is behind a light is seen through it


def light(export: Export, obj: bpy.types.Object, world: np.ndarray, middle: np.ndarray, size: float) -> Plugin | None:
    """The emitter of an evaluated light object; ``world`` [4, 4] places it in a scene of radius ``size`` around its
    ``middle`` [3]."""
    data = obj.data
    color = _color(export, data)
    if data.energy < 0:
        export.note('"{light}": a light of negative power is left out', light=data.name)
    if not color.any() or _is_portal(data):
        return None
    if not data.use_shadow:
        export.note('"{light}": a light without shadows casts shadows here', light=data.name)
    if data.type == "SUN":
        return _sun(data, color * _of_size(data), world, middle, size)
    if data.type == "SPOT":
        return _spot(export, data, color / (4 * math.pi) * _of_size(data), world)
    if data.type == "AREA":
        return _area(export, data, color, world)
    return _point(data, color * _of_size(data), world)


def _of_size(data: bpy.types.Light) -> float:
    """What the power of a light is multiplied by, where its size decides how much light it gives."""
    if getattr(data, "normalize", True) or data.type == "AREA":
        return 1.0
    if data.type == "SUN":
        return math.pi * math.sin(data.angle / 2) ** 2 if data.angle else 1.0
    return 4 * math.pi * data.shadow_soft_size**2 if data.shadow_soft_size else 4.0


def _is_portal(data: bpy.types.Light) -> bool:
    """Whether it only shows Cycles where the light of the world comes in, and has none of its own."""
    return data.type == "AREA" and hasattr(data, "cycles") and data.cycles.is_portal


def _color(export: Export, data: bpy.types.Light) -> np.ndarray:
    """[3], times its power."""
    color = np.array(data.color, np.float64) * data.energy * 2 ** getattr(data, "exposure", 0.0)
    if getattr(data, "use_temperature", False):
        color *= np.array(data.temperature_color[:3])
    color = np.maximum(from_working(color), 0)
    tree = active_tree(data)
    if tree is None:
        return color
    output, reader = output_of(tree), Reader(export, data.name)
    source = reader.source(output.inputs["Surface"]) if output else None
    if source is None:
        return np.zeros(3)
    node = source.node
    if node.type != "EMISSION":
        reader.note('the node "{node}" has no counterpart in Mitsuba; it shines as without nodes', node=node.name)
        return color
    emission = reader.color(node.inputs["Color"])
    color *= reader.constant(node.inputs["Strength"])
    if emission["type"] == "rgb":
        return color * np.array(emission["value"])
    reader.note('the texture of "{socket}" is left out', socket=node.inputs["Color"].name)
    return color


def _point(data: bpy.types.Light, color: np.ndarray, world: np.ndarray) -> Plugin:
    radius, place = data.shadow_soft_size, world[:3, 3]
    if radius == 0:
        return {"type": "point", "position": place.tolist(), "intensity": rgb(color / (4 * math.pi))}
    emitter = {"type": "area", "radiance": rgb(color / (4 * math.pi**2 * radius**2))}
    return {"type": "sphere", "center": place.tolist(), "radius": radius, "bsdf": NOTHING, "emitter": emitter}


def _spot(export: Export, data: bpy.types.Light, intensity: np.ndarray, world: np.ndarray) -> Plugin:
    """Sharp, as Mitsuba's has no size; Blender's soft edge, of a cone that is scaled unevenly an ellipse, is a texture
    that it throws."""
    if data.shadow_soft_size > 0:
        export.note('"{light}": the shadows of a spot are sharp', light=data.name)
    scale = np.maximum(np.linalg.norm(world[:3, :3], axis=0), 1e-12)
    x, y = scale[:2] / scale[2]
    half = min(math.atan(math.tan(min(data.spot_size / 2, WIDEST)) * max(x, y)), WIDEST)
    across = math.tan(half) * ((np.arange(FALLOFF_PIXELS) + 0.5) / FALLOFF_PIXELS * 2 - 1)
    cosine = 1 / np.hypot(1, np.hypot(across[:, None] / y, across / x))
    inside = cosine - math.cos(data.spot_size / 2)
    width = (1 - math.cos(data.spot_size / 2)) * data.spot_blend
    t = np.clip(inside / width, 0, 1) if width > 0 else (inside > 0).astype(float)
    degrees = math.degrees(half)
    return {
        "type": "spot", "to_world": matrix(_rigid(world) @ LOOKING), "intensity": rgb(intensity),
        "cutoff_angle": degrees, "beam_width": 0.999 * degrees, "texture": write_gray(export, t * t * (3 - 2 * t)),
    }  # fmt: skip


def _area(export: Export, data: bpy.types.Light, power: np.ndarray, world: np.ndarray) -> Plugin | None:
    """None where it has no size, and so gives no light in Cycles either."""
    if data.spread < math.pi - 0.01:
        export.note('"{light}": an area light shines to all sides, whatever its spread', light=data.name)
    width, height = data.size, data.size_y if data.shape in ("RECTANGLE", "ELLIPSE") else data.size
    place = world @ np.diag([width / 2, height / 2, 1, 1])
    across, along = (np.linalg.norm(place[:3, k]) for k in (0, 1))
    is_round = data.shape in ("DISK", "ELLIPSE")
    area = across * along * (math.pi if is_round else 4)
    if area == 0:
        return None
    emitter = {"type": "area", "radiance": rgb(power / (math.pi * (area if getattr(data, "normalize", True) else 1)))}
    shape = "disk" if is_round else "rectangle"
    return {"type": shape, "to_world": matrix(place @ LOOKING), "bsdf": NOTHING, "emitter": emitter}


def _sun(data: bpy.types.Light, irradiance: np.ndarray, world: np.ndarray, middle: np.ndarray, size: float) -> Plugin:
    """A direction, or a disk far from the scene where it is wide enough for soft shadows."""
    placed = _rigid(world) @ LOOKING
    if data.angle < SHARP_SUN:
        return {"type": "directional", "direction": placed[:3, 2].tolist(), "irradiance": rgb(irradiance)}
    half, distance = data.angle / 2, FAR * size
    placed[:3, 3] = middle - distance * placed[:3, 2]
    disk = placed @ np.diag([distance * math.tan(half), distance * math.tan(half), 1, 1])
    emitter = {"type": "area", "radiance": rgb(irradiance / (math.pi * math.sin(half) ** 2))}
    return {"type": "disk", "to_world": matrix(disk), "bsdf": NOTHING, "emitter": emitter}


def _rigid(world: np.ndarray) -> np.ndarray:
    """Without its scale."""
    found = world.copy()
    found[:3, :3] /= np.maximum(np.linalg.norm(world[:3, :3], axis=0), 1e-12)
    return found
