"""Fields of the node tree: the active camera as the object sees it, and the attributes of a splat."""

from __future__ import annotations

from ..objects.attributes import BASE, OPACITY_FACTOR, ROTATION, SCALE, SCALE_FACTOR
from .builder import Tree, Value, Vector
from .groups import named_attribute

JACOBIAN_MARGIN = 0.15  # of the image on every side: J is evaluated at most there (the 1.3 tan(fov / 2) of 3DGS)


class Frame:
    """The active camera as the object sees it, in fields of the splats."""

    def __init__(self, tree: Tree, focal: tuple[Value, Value], center: tuple[Value, Value], size: tuple[Value, Value]):
        info = tree.node("GeometryNodeObjectInfo", transform_space="RELATIVE")
        tree.plug(info.inputs["Object"], tree.node("GeometryNodeInputActiveCamera").outputs[0])
        self.rotation = info.outputs["Rotation"]
        self.right, self.down, self.forward = (
            self._rotated(tree, axis) for axis in ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
        )
        position = Vector(tree, tree.node("GeometryNodeInputPosition").outputs[0])
        self.direction = position - Vector(tree, info.outputs["Location"])
        self.depth = self.direction.dot(self.forward)
        self.focal = focal
        self.tangents = []  # of the viewing angles, held inside of the image and its margin
        for axis, f, c, n in zip((self.right, self.down), focal, center, size, strict=True):
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
        channels = tree.node("FunctionNodeSeparateColor")
        tree.plug(channels.inputs[0], named_attribute(tree, BASE, "FLOAT_COLOR"))
        self.opacity = Value(tree, channels.outputs["Alpha"])
        self.pseudo_opacity = self.opacity * named_attribute(tree, OPACITY_FACTOR, "FLOAT") * dog
        self.scale = named_attribute(tree, SCALE)
        self.pseudo_scale = self.scale * named_attribute(tree, SCALE_FACTOR)
        self.rotation = named_attribute(tree, ROTATION, "QUATERNION")
