"""Fields of the node trees: what a camera or a viewport makes of a splat, and the attributes of a splat."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..objects.attributes import BASE, OPACITY_FACTOR, ROTATION, SCALE, SCALE_FACTOR
from .builder import Tree, Value, Vector
from .groups import named_attribute

JACOBIAN_MARGIN = 0.15  # of the image on every side: J is evaluated at most there (the 1.3 tan(fov / 2) of 3DGS)


class Pose(NamedTuple):
    """Where a picture is taken from, in the space of the object, and its intrinsics in pixels (x, y, 0)."""

    location: Vector
    rotation: Any
    focal: Vector
    center: Vector
    size: Vector


def camera_pose(tree: Tree) -> tuple[Vector, Any]:
    """Location and rotation of the active camera as the object sees it."""
    info = tree.node("GeometryNodeObjectInfo", transform_space="RELATIVE")
    tree.plug(info.inputs["Object"], tree.node("GeometryNodeInputActiveCamera").outputs[0])
    return Vector(tree, info.outputs["Location"]), info.outputs["Rotation"]


class Frame:
    """What a pose makes of the splats, in fields."""

    def __init__(self, tree: Tree, pose: Pose):
        self.rotation = pose.rotation
        self.right, self.down, self.forward = (
            self._rotated(tree, axis) for axis in ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
        )
        position = Vector(tree, tree.node("GeometryNodeInputPosition").outputs[0])
        self.direction = position - pose.location
        self.depth = self.direction.dot(self.forward)
        self.focal = tuple(pose.focal.split()[:2])
        self.tangents = []  # of the viewing angles, held inside of the image and its margin
        intrinsics = zip(self.focal, pose.center.split()[:2], pose.size.split()[:2], strict=True)
        for axis, (f, c, n) in zip((self.right, self.down), intrinsics, strict=True):
            margin = n / f * JACOBIAN_MARGIN
            low, high = (c / f + margin) * -1.0, (n - c) / f + margin
            tangent = tree.math("MAXIMUM", self.direction.dot(axis) / self.depth, low)
            self.tangents.append(tree.math("MINIMUM", tangent, high))

    def _rotated(self, tree: Tree, axis: tuple[float, float, float]) -> Vector:
        node = tree.node("FunctionNodeRotateVector")
        tree.plug(node.inputs["Vector"], axis)
        tree.plug(node.inputs["Rotation"], self.rotation)
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
