"""Our modifiers on an object: inputs by name, and drivers that tell the drawing one the camera's intrinsics."""

from __future__ import annotations

import math
import re
from typing import Any

import bpy

from ..objects.keys import scale_keys
from .crop import NAME as CROP
from .crop import SHAPES
from .limits import NAME as LIMITS
from .limits import ORDERS
from .paint import NAME as PAINT
from .space import space_of
from .tree import NAME, PROJECTION, SHOW, splat_tree

EDITING = (CROP, LIMITS, PAINT)
SHOWN = ("Show As", "SH Degree", "DoG", "Linear Colors", "Antialiased", "Near Clip", "Viewport Share")
MENUS = {"Show As": SHOW, "Shape": SHAPES, "Count By": ORDERS}

# Horizontal: what Blender's sensor fit "Auto" decides. Enum values: 0 Auto, 1 Horizontal, 2 Vertical. Sizes in pixels
# are those of the render: whole ones. Blender keeps 255 characters of an expression.
_WIDTH, _HEIGHT = "floor(rx*percent/100)", "floor(ry*percent/100)"
_SIZE = f"({_WIDTH}*ax if fit==1 or (fit==0 and rx*ax>=ry*ay) else {_HEIGHT}*ay)"  # along the side that the sensor fits
_PINHOLE = f"{_SIZE}/(scale if kind==1 else (sh if fit==2 else sw)/lens)"
_ANGLE = "(east-west if dome==0 else sw/bent if dome==2 else fov)"  # across a panorama, as near its axis
_FOCAL = f"({_WIDTH}*ax/{_ANGLE} if kind==2 else {_PINHOLE})"  # in units of square pixels, as the size is
EXPRESSIONS = {
    PROJECTION: "min(kind, 2)",  # 3 is a lens that a script describes
    "Focal X": f"{_FOCAL}/ax",
    "Focal Y": f"{_FOCAL}/ay",
    "Center X": f"{_WIDTH}/2-sx*{_SIZE}/ax",
    "Center Y": f"{_HEIGHT}/2+sy*{_SIZE}/ay",
    "Width": _WIDTH,
    "Height": _HEIGHT,
    "Left Eye": "(0 if pivot==0 else -2 if pivot==1 else -1) if several and not other else 0",
    "Right Eye": "(2 if pivot==0 else 0 if pivot==1 else 1) if several and not other else 0",
    "Eye Distance": "apart",
    "Toe-In": "atan(apart/2/meet) if mode==2 else 0",
    "Convergence": "1/meet if mode==0 else 0",
}
VARIABLES = {  # path from the scene, and the value where the scene has no camera
    "lens": ("camera.data.lens", 50), "sw": ("camera.data.sensor_width", 36), "sh": ("camera.data.sensor_height", 24),
    "kind": ("camera.data.type", 0), "scale": ("camera.data.ortho_scale", 6),
    "fit": ("camera.data.sensor_fit", 0), "sx": ("camera.data.shift_x", 0), "sy": ("camera.data.shift_y", 0),
    "rx": ("render.resolution_x", 0), "ry": ("render.resolution_y", 0), "percent": ("render.resolution_percentage", 0),
    "ax": ("render.pixel_aspect_x", 1), "ay": ("render.pixel_aspect_y", 1),
    "dome": ("camera.data.panorama_type", 0), "west": ("camera.data.longitude_min", -math.pi),
    "east": ("camera.data.longitude_max", math.pi), "fov": ("camera.data.fisheye_fov", math.pi),
    "bent": ("camera.data.fisheye_lens", 10.5),
    "several": ("render.use_multiview", 0), "other": ("render.views_format", 0),  # 0: Stereo 3D
    "pivot": ("camera.data.stereo.pivot", 2), "mode": ("camera.data.stereo.convergence_mode", 0),
    "apart": ("camera.data.stereo.interocular_distance", 0), "meet": ("camera.data.stereo.convergence_distance", 1),
}  # fmt: skip


def add_modifier(obj: bpy.types.Object) -> bpy.types.Modifier:
    """Give an object, whose light is known, the splat modifier with its drivers.

    Cycles is told to blur no deformation: it would do so from a quad to the one that is drawn in its turn at another
    time of the shutter, which is another splat's. What a moving camera or object blurs stays.
    """
    modifier = obj.modifiers.new(NAME, "NODES")
    modifier.node_group = splat_tree(space_of(obj))
    drive(modifier)
    if hasattr(obj, "cycles"):
        obj.cycles.use_deform_motion = False
    return modifier


def add_edit_modifier(obj: bpy.types.Object, tree: bpy.types.NodeTree, first: bool = False) -> bpy.types.Modifier:
    """Give an object one of the modifiers that edit, just before the one that draws, or as the first of all."""
    modifier = obj.modifiers.new(tree.name, "NODES")
    modifier.node_group = tree
    drawing = splat_modifier(obj)
    last = len(obj.modifiers) - 1
    place = 0 if first else last if drawing is None else obj.modifiers.find(drawing.name)
    obj.modifiers.move(last, place)
    return modifier


def splat_modifier(obj: bpy.types.Object) -> bpy.types.Modifier | None:
    """The modifier of ours that draws the splats of an object."""
    return next((modifier for modifier in obj.modifiers if tree_name(modifier) == NAME), None)


def edit_modifiers(obj: bpy.types.Object, *names: str) -> list[bpy.types.Modifier]:
    """The modifiers of ours that edit the splats of an object, all or those of these trees."""
    return [modifier for modifier in obj.modifiers if tree_name(modifier) in (names or EDITING)]


def tree_name(modifier: bpy.types.Modifier) -> str | None:
    """Which of our trees a modifier has, by the name that the tree was made under; None for trees of others."""
    group = modifier.node_group if modifier.type == "NODES" else None
    key = str(group.get("dogsplat", "")) if group else ""
    return key.rpartition(" ")[0] or None


def has_input(modifier: bpy.types.Modifier, name: str) -> bool:
    """Whether the tree has that input: those of older versions have fewer."""
    return any(item.item_type == "SOCKET" and item.in_out == "INPUT" and item.name == name
               for item in modifier.node_group.interface.items_tree)  # fmt: skip


def input_property(modifier: bpy.types.Modifier, name: str) -> tuple[Any, str]:
    """(Who has the input ``name`` of the modifier, as which property): what a layout draws."""
    items = modifier.node_group.interface.items_tree
    key = next(i.identifier for i in items if i.item_type == "SOCKET" and i.in_out == "INPUT" and i.name == name)
    if hasattr(modifier, "properties"):  # from Blender 5.2 on
        return getattr(modifier.properties.inputs, key), "value"
    return modifier, f'["{key}"]'


def set_input(modifier: bpy.types.Modifier, name: str, value: Any) -> None:
    """Set an input of the modifier; a menu to one of its names."""
    owner, key = input_property(modifier, name)
    if key == "value":
        owner.value = value
    else:  # a menu is a number there
        owner[key[2:-2]] = MENUS[name].index(value) if name in MENUS else value


def get_input(modifier: bpy.types.Modifier, name: str) -> Any:
    """The value of an input of the modifier, as ``set_input`` takes it."""
    owner, key = input_property(modifier, name)
    value = owner.path_resolve(key)
    return MENUS[name][value] if isinstance(value, int) and name in MENUS else value


def scale_limits(obj: bpy.types.Object, factor: float) -> None:
    """Let limits on sizes, which are in units of the object, leave the same splats that are scaled by a factor.

    Keys of them are scaled too.
    """
    for modifier in edit_modifiers(obj, LIMITS):
        for name in ("Minimum Size", "Maximum Size"):
            set_input(modifier, name, get_input(modifier, name) * factor)
            scale_keys(obj, _input_path(modifier, name), factor)
    obj.update_tag()


def _input_path(modifier: bpy.types.Modifier, name: str) -> str:
    """Where keys and drivers of the object find an input."""
    owner, key = input_property(modifier, name)
    return owner.path_from_id() + (key if key.startswith("[") else f".{key}")


def drive(modifier: bpy.types.Modifier) -> None:
    """Let drivers tell a drawing modifier of the active camera, in place of those that it has."""
    for name, expression in EXPRESSIONS.items():
        owner, key = input_property(modifier, name)
        owner.driver_remove(key)
        _drive(owner, key, expression)


def is_driven(modifier: bpy.types.Modifier) -> bool:
    """Whether a drawing modifier has all of these drivers, as this version of the add-on makes them."""
    if (animation := modifier.id_data.animation_data) is None:
        return False
    found = {name: animation.drivers.find(_input_path(modifier, name)) for name in EXPRESSIONS}
    return all(curve is not None and curve.driver.expression == EXPRESSIONS[name] for name, curve in found.items())


def _drive(owner: Any, key: str, expression: str) -> None:
    driver = owner.driver_add(key).driver
    driver.type = "SCRIPTED"
    for name in filter(VARIABLES.__contains__, dict.fromkeys(re.findall(r"[a-z]+", expression))):
        source, fallback = VARIABLES[name]
        variable = driver.variables.new()
        variable.name, variable.type = name, "CONTEXT_PROP"
        target = variable.targets[0]
        target.context_property, target.data_path = "ACTIVE_SCENE", source
        target.use_fallback_value, target.fallback_value = True, fallback
    driver.expression = expression
