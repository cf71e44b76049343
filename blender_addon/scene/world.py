"""The world as an emitter: a colour, or an equirectangular picture with its rotation and strength."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Euler

from ..objects.working_space import from_working
from .export import Export, Plugin, blender_rgb, matrix, rgb
from .images import environment
from .sockets import OWN_VALUE, Reader, active_tree, constant_of, output_of, source_of

RAYS = ("camera", "diffuse", "glossy", "transmission")  # that Cycles tells apart
# A direction in the coordinates of the picture, as Blender looks it up, in those of Mitsuba's envmap
ENVMAP_FROM_BLENDER = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])


def world_light(export: Export, world: bpy.types.World | None) -> Plugin | None:
    """None where it is black."""
    if world is None:
        return None
    tree, reader = active_tree(world), Reader(export, world.name)
    if tree is None:
        return _constant(from_working(world.color))
    output = output_of(tree)
    if output is not None and reader.source(output.inputs["Volume"]) is not None:
        reader.note("its volume is left out")
    rays = getattr(world, "cycles_visibility", None)
    if rays is not None and not all(getattr(rays, name) for name in RAYS):
        reader.note("its Ray Visibility is ignored")
    source = reader.source(output.inputs["Surface"]) if output else None
    if source is None:
        return None
    if source.node.type != "BACKGROUND":
        reader.note(
            'the node "{node}" has no counterpart in Mitsuba; the world has its viewport color', node=source.node.name
        )
        return _constant(from_working(world.color))
    color, strength = source.node.inputs["Color"], reader.constant(source.node.inputs["Strength"])
    picture = reader.source(color)
    if picture is not None and picture.node.type == "TEX_ENVIRONMENT" and picture.node.image is not None:
        return _picture(reader, picture.node, strength)
    found = reader.color(color, strength)
    if found["type"] != "rgb":  # an image by texture coordinates, which directions have none of
        reader.note(OWN_VALUE, node=picture.node.name)
        return _constant(blender_rgb(np.multiply(color.default_value[:3], strength))["value"])
    return _constant(found["value"])


def is_plain(world: bpy.types.World | None) -> bool:
    """Whether it is one colour everywhere, textures that lie unused among its nodes or not."""
    tree = active_tree(world) if world else None
    if tree is None or one_color(world) is not None:
        return True
    return not any(node.type.startswith("TEX_") for node in tree.nodes)


def one_color(world: bpy.types.World | None) -> np.ndarray | None:
    """The linear colour [3] of the Background node that a world shows, or of the world without nodes; None where other
    nodes calculate it."""
    if world is None:
        return np.zeros(3)
    if (tree := active_tree(world)) is None:
        return np.array(world.color)
    output = output_of(tree)
    source = source_of(output.inputs["Surface"]) if output else None
    if source is None:
        return np.zeros(3)
    if source.node.type != "BACKGROUND":
        return None
    color, strength = (constant_of(source.node.inputs[name]) for name in ("Color", "Strength"))
    return None if color is None or strength is None else np.ones(3) * color * np.mean(strength)


def _picture(reader: Reader, node: bpy.types.Node, strength: float) -> Plugin | None:
    if node.projection != "EQUIRECTANGULAR":
        reader.note("the picture of the world is treated as equirectangular")
    name = environment(reader.export, node.image)
    if name is None:
        return None
    to_world = np.eye(4)
    to_world[:3, :3] = (ENVMAP_FROM_BLENDER @ _rotation(reader, node)).T
    return {"type": "envmap", "filename": name, "scale": strength, "to_world": matrix(to_world)}


def _rotation(reader: Reader, node: bpy.types.Node) -> np.ndarray:
    """[3, 3] from directions to those in which the picture is looked up, perhaps mirrored."""
    source, found = reader.source(node.inputs["Vector"]), np.eye(3)
    if source is not None and source.node.type == "MAPPING":
        mapping = source.node
        if mapping.vector_type not in ("POINT", "VECTOR", "TEXTURE"):
            reader.note('the mapping "{mapping}" is left out', mapping=mapping.name)
            return found
        turned = np.array(Euler(reader.vector(mapping.inputs["Rotation"])).to_matrix(), np.float64)
        scale = reader.vector(mapping.inputs["Scale"])
        moves = mapping.vector_type != "VECTOR" and reader.vector(mapping.inputs["Location"]).any()
        if moves or not np.allclose(np.abs(scale), np.abs(scale[0])) or not scale.all():
            reader.note('of the mapping "{mapping}" only the rotation is drawn', mapping=mapping.name)
            scale = np.ones(3)
        mirror = np.diag(np.sign(scale))  # a direction has no length
        found = mirror @ turned.T if mapping.vector_type == "TEXTURE" else turned @ mirror
        source = reader.source(mapping.inputs["Vector"])
        if source is None:
            reader.note('the mapping "{mapping}" is left out', mapping=mapping.name)
    if source is not None and not _is_direction(source):
        reader.note('the picture of the world is looked up by directions, instead of "{node}"', node=source.node.name)
    return found


def _is_direction(source: Any) -> bool:
    """Whether it gives directions as they are: those of an object that is turned are others."""
    if source.node.type != "TEX_COORD":
        return False
    return source.name == "Generated" or source.name == "Object" and source.node.object is None


def _constant(color) -> Plugin | None:
    return {"type": "constant", "radiance": rgb(color)} if any(color[:3]) else None
