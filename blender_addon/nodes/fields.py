"""Fields of the node trees: what a camera or a viewport makes of a splat, and the attributes of a splat."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy

from ..objects.attributes import BASE, OPACITY_FACTOR, ROTATION, SCALE, SCALE_FACTOR
from .builder import Tree, Value, Vector, new_group
from .geometry import switch
from .groups import GEOMETRY, cached_group, finish_group, named_attribute

PARALLEL, ALL_AROUND = 1, 2  # projections, as Blender numbers types of cameras; 0 is perspective
JACOBIAN_MARGIN = 0.15  # of the image on every side: J is evaluated at most there (the 1.3 tan(fov / 2) of 3DGS)


def _sockets(fields: tuple[str, ...], **others: str) -> dict[str, str]:
    """Sockets of a group for the fields of a tuple, in their order: vectors, but for ``others``."""
    return {name.capitalize(): others.get(name, "NodeSocketVector") for name in fields}


class Pose(NamedTuple):
    """Where a picture is taken from, in the space of the world, and its intrinsics in pixels (x, y, 0).

    ``mirror`` is 1, or -1 for a mirrored camera, whose axes are those of the ``rotation`` the other way. ``focal`` is
    in pixels per unit where the rays are parallel, and per radian in a panorama.
    """

    location: Vector
    rotation: Any
    mirror: Value
    focal: Vector
    center: Vector
    size: Vector
    projection: Value


POSE = _sockets(Pose._fields, rotation="NodeSocketRotation", mirror="NodeSocketFloat", projection="NodeSocketFloat")


def sees(pose: Pose, projection: int) -> Value:
    """1 where the pose has that projection."""
    return (pose.projection > projection - 0.5) * (pose.projection < projection + 0.5)


def camera_pose(tree: Tree) -> tuple[Vector, Any, Value]:
    """Location, rotation and mirror of the active camera in the world."""
    info = _object_info(tree, "GeometryNodeInputActiveCamera")
    x, _, _ = Vector(tree, info.outputs["Scale"]).split()  # of what is mirrored all three are below 0
    return Vector(tree, info.outputs["Location"]), info.outputs["Rotation"], 1.0 - (x < 0.0) * 2.0


def _object_info(tree: Tree, which: str) -> Any:
    info = tree.node("GeometryNodeObjectInfo", transform_space="ORIGINAL")
    tree.plug(info.inputs["Object"], tree.node(which).outputs[0])
    return info


class Frame(NamedTuple):
    """What a pose makes of the splats, in fields.

    The object may be mirrored, or scaled differently along its axes: with A from its space to the world, a step p in it
    goes ``r · A p`` to the right, so ``right`` is Aᵀ r, and so are ``down`` and ``forward``. ``across`` and ``up`` are
    the steps in the space of the object that are r and -d in the world. ``unit`` is that of the object in the world,
    its mean along three axes. ``direction`` is that in the space of the object, which the colours are for. Depths are
    those of the world. ``focal`` is in pixels for steps in the world that are as long as the ``distance``: the depth;
    in a panorama how far the splat is; for parallel rays 1. ``tangents`` of the viewing angles (x, y, 0) are held
    inside of the image and its margin.
    """

    right: Vector
    down: Vector
    forward: Vector
    across: Vector
    up: Vector
    unit: Value
    direction: Vector
    depth: Value
    distance: Value
    focal: Vector
    tangents: Vector


FRAME = _sockets(Frame._fields, **dict.fromkeys(("unit", "depth", "distance"), "NodeSocketFloat"))


def frame_group() -> bpy.types.NodeTree:
    """The ``Frame`` of a ``Pose``."""
    name = "DoG Splat frame"
    if existing := cached_group(name):
        return existing
    tree, inputs, exit_node = new_group(name, GEOMETRY, POSE, FRAME)
    pose = Pose(*inputs)
    to_world = _object_info(tree, "GeometryNodeSelfObject").outputs["Transform"]
    transposed, to_object = (tree.node(f"FunctionNode{kind}Matrix") for kind in ("Transpose", "Invert"))
    for node in (transposed, to_object):
        tree.plug(node.inputs[0], to_world)
    own = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)
    axes = [rotated(tree, axis, pose.rotation) * pose.mirror for axis in own]
    right, down, forward = (_transformed(tree, "Direction", axis, transposed.outputs[0]) for axis in axes)
    across, downward, along = (_transformed(tree, "Direction", axis, to_object.outputs[0]) for axis in axes)
    volume = tree.math("ABSOLUTE", right.dot(down.cross(forward)))
    unit = tree.math("POWER", volume, 1 / 3)
    position = Vector(tree, tree.node("GeometryNodeInputPosition").outputs[0])
    offset = position - _transformed(tree, "Point", pose.location, to_object.outputs[0])
    depth, parallel = offset.dot(forward), sees(pose, PARALLEL)
    direction = switch(tree, "VECTOR", parallel, offset, along)
    far = switch(tree, "FLOAT", sees(pose, ALL_AROUND), depth, offset.length() * unit)
    distance = switch(tree, "FLOAT", parallel, far, 1.0)
    tangents = []
    of_axes = zip(*(v.split() for v in (pose.focal, pose.center, pose.size)), strict=True)
    for axis, of_axis in zip((right, down), of_axes, strict=False):
        f, c, n = of_axis
        margin = n / f * JACOBIAN_MARGIN
        low, high = (c / f + margin) * -1.0, (n - c) / f + margin
        tangent = tree.math("MAXIMUM", offset.dot(axis) / depth, low)
        tangents.append(tree.math("MINIMUM", tangent, high) * (1.0 - parallel))
    of_view = right, down, forward, across, downward * -1.0
    tree.give(exit_node, Frame(*of_view, unit, direction, depth, distance, pose.focal, tree.combine(*tangents)))
    return finish_group(tree, name)


def rotated(tree: Tree, axis: tuple[float, float, float], rotation: Any) -> Vector:
    """A constant direction, turned."""
    node = tree.node("FunctionNodeRotateVector")
    tree.plug(node.inputs["Vector"], axis)
    tree.plug(node.inputs["Rotation"], rotation)
    return Vector(tree, node.outputs[0])


def _transformed(tree: Tree, kind: str, vector: Vector, matrix: Any) -> Vector:
    node = tree.node(f"FunctionNodeTransform{kind}")
    tree.plug(node.inputs[0], vector)
    tree.plug(node.inputs["Transform"], matrix)
    return Vector(tree, node.outputs[0])


class Splat:
    """The attributes of a splat as fields."""

    def __init__(self, tree: Tree, dog: Value):
        self.opacity = opacity(tree)
        self.pseudo_opacity = self.opacity * named_attribute(tree, OPACITY_FACTOR, "FLOAT") * dog
        self.scale = named_attribute(tree, SCALE)
        self.pseudo_scale = self.scale * named_attribute(tree, SCALE_FACTOR)
        self.rotation = named_attribute(tree, ROTATION, "QUATERNION")


def opacity(tree: Tree) -> Value:
    """Opacity of a splat."""
    channels = tree.node("FunctionNodeSeparateColor")
    tree.plug(channels.inputs[0], named_attribute(tree, BASE, "FLOAT_COLOR"))
    return Value(tree, channels.outputs["Alpha"])


def mean_scale(tree: Tree) -> Value:
    """Of a splat along its three axes."""
    return named_attribute(tree, SCALE).dot((1 / 3, 1 / 3, 1 / 3))


def importance(tree: Tree) -> Value:
    """Opacity times the area of the largest cross-section, as ``files.model.importance``."""
    x, y, z = named_attribute(tree, SCALE).split()
    return opacity(tree) * tree.math("MAXIMUM", tree.math("MAXIMUM", x * y, y * z), z * x)
