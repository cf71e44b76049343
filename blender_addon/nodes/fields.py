"""Fields of the node trees: what a camera or a viewport makes of a splat, and the attributes of a splat."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..objects.attributes import BASE, OPACITY_FACTOR, ROTATION, SCALE, SCALE_FACTOR
from .builder import Tree, Value, Vector
from .groups import named_attribute

JACOBIAN_MARGIN = 0.15  # of the image on every side: J is evaluated at most there (the 1.3 tan(fov / 2) of 3DGS)


class Pose(NamedTuple):
    """Where a picture is taken from, in the space of the world, and its intrinsics in pixels (x, y, 0)."""

    location: Vector
    rotation: Any
    focal: Vector
    center: Vector
    size: Vector


def camera_pose(tree: Tree) -> tuple[Vector, Any]:
    """Location and rotation of the active camera in the world."""
    info = _object_info(tree, "GeometryNodeInputActiveCamera")
    return Vector(tree, info.outputs["Location"]), info.outputs["Rotation"]


def _object_info(tree: Tree, which: str) -> Any:
    info = tree.node("GeometryNodeObjectInfo", transform_space="ORIGINAL")
    tree.plug(info.inputs["Object"], tree.node(which).outputs[0])
    return info


class Frame:
    """What a pose makes of the splats, in fields.

    The object may be mirrored, or scaled differently along its axes: with A from its space to the world, a step p in it
    goes ``r · A p`` to the right, so ``right`` is Aᵀ r, and so are ``down`` and ``forward``. Depths are those of the
    world. ``across`` and ``up`` are the steps in the space of the object that are r and -d in the world. ``direction``
    is that in the space of the object, which the colours are for.
    """

    def __init__(self, tree: Tree, pose: Pose):
        to_world = _object_info(tree, "GeometryNodeSelfObject").outputs["Transform"]
        transposed, to_object = (tree.node(f"FunctionNode{kind}Matrix") for kind in ("Transpose", "Invert"))
        for node in (transposed, to_object):
            tree.plug(node.inputs[0], to_world)
        axes = [_rotated(tree, axis, pose.rotation) for axis in ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))]
        self.right, self.down, self.forward = (
            _transformed(tree, "Direction", axis, transposed.outputs[0]) for axis in axes
        )
        self.across = _transformed(tree, "Direction", axes[0], to_object.outputs[0])
        self.up = _transformed(tree, "Direction", axes[1], to_object.outputs[0]) * -1.0
        volume = tree.math("ABSOLUTE", self.right.dot(self.down.cross(self.forward)))
        self.unit = tree.math("POWER", volume, 1 / 3)  # of the object in the world, its mean along three axes
        position = Vector(tree, tree.node("GeometryNodeInputPosition").outputs[0])
        self.direction = position - _transformed(tree, "Point", pose.location, to_object.outputs[0])
        self.depth = self.direction.dot(self.forward)
        self.focal = tuple(pose.focal.split()[:2])
        self.tangents = []  # of the viewing angles, held inside of the image and its margin
        intrinsics = zip(self.focal, pose.center.split()[:2], pose.size.split()[:2], strict=True)
        for axis, (f, c, n) in zip((self.right, self.down), intrinsics, strict=True):
            margin = n / f * JACOBIAN_MARGIN
            low, high = (c / f + margin) * -1.0, (n - c) / f + margin
            tangent = tree.math("MAXIMUM", self.direction.dot(axis) / self.depth, low)
            self.tangents.append(tree.math("MINIMUM", tangent, high))


def _rotated(tree: Tree, axis: tuple[float, float, float], rotation: Any) -> Vector:
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


def importance(tree: Tree) -> Value:
    """Opacity times the area of the largest cross-section, as ``files.model.importance``."""
    x, y, z = named_attribute(tree, SCALE).split()
    return opacity(tree) * tree.math("MAXIMUM", tree.math("MAXIMUM", x * y, y * z), z * x)
