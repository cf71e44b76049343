"""Formulas as node trees: numbers and sockets combine to sockets with Python's own operators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy


class Value:
    """A float output socket; + - * / and comparisons make Math nodes."""

    def __init__(self, tree: Tree, socket: bpy.types.NodeSocket):
        self.tree, self.socket = tree, socket

    def __add__(self, other: Any) -> Value:
        return self.tree.math("ADD", self, other)

    def __sub__(self, other: Any) -> Value:
        return self.tree.math("SUBTRACT", self, other)

    def __rsub__(self, other: Any) -> Value:
        return self.tree.math("SUBTRACT", other, self)

    def __mul__(self, other: Any) -> Value:
        return self.tree.math("MULTIPLY", self, other)

    def __truediv__(self, other: Any) -> Value:
        return self.tree.math("DIVIDE", self, other)

    def __rtruediv__(self, other: Any) -> Value:
        return self.tree.math("DIVIDE", other, self)

    def __gt__(self, other: Any) -> Value:
        return self.tree.math("GREATER_THAN", self, other)

    def __lt__(self, other: Any) -> Value:
        return self.tree.math("LESS_THAN", self, other)

    __radd__, __rmul__ = __add__, __mul__


class Vector:
    """A vector output socket; + - * / work per component, a float scales."""

    def __init__(self, tree: Tree, socket: bpy.types.NodeSocket):
        self.tree, self.socket = tree, socket

    def __add__(self, other: Any) -> Vector:
        return self.tree.vector_math("ADD", self, other)

    def __sub__(self, other: Any) -> Vector:
        return self.tree.vector_math("SUBTRACT", self, other)

    def __mul__(self, other: Any) -> Vector:
        if isinstance(other, (Value, int, float)):
            node = self.tree.node("ShaderNodeVectorMath", operation="SCALE")
            self.tree.plug(node.inputs["Vector"], self)
            self.tree.plug(node.inputs["Scale"], other)
            return Vector(self.tree, node.outputs["Vector"])
        return self.tree.vector_math("MULTIPLY", self, other)

    def __truediv__(self, other: Any) -> Vector:
        return self.tree.vector_math("DIVIDE", self, other)

    def dot(self, other: Any) -> Value:
        return self.tree.vector_math("DOT_PRODUCT", self, other, output="Value")

    def cross(self, other: Any) -> Vector:
        return self.tree.vector_math("CROSS_PRODUCT", self, other)

    def maximum(self, other: Any) -> Vector:
        return self.tree.vector_math("MAXIMUM", self, other)

    def length(self) -> Value:
        return self.tree.vector_math("LENGTH", self, output="Value")

    def normalized(self) -> Vector:
        return self.tree.vector_math("NORMALIZE", self)

    def split(self) -> list[Value]:
        """x, y, z."""
        node = self.tree.node("ShaderNodeSeparateXYZ")
        self.tree.plug(node.inputs[0], self)
        return [Value(self.tree, socket) for socket in node.outputs]


class Tree:
    """Adds nodes to a node tree, geometry or shader."""

    def __init__(self, tree: bpy.types.NodeTree):
        self.tree = tree

    def node(self, kind: str, **properties: Any) -> Any:
        """A new node of type ``kind`` with some of its properties set."""
        node = self.tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(node, name, value)
        return node

    def plug(self, socket: bpy.types.NodeSocket, value: Any) -> None:
        """Connect an input to what it shall have: one of our values, a socket, or a constant."""
        if isinstance(value, (Value, Vector)):
            value = value.socket
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        elif value is not None:
            socket.default_value = value

    def math(self, operation: str, *operands: Any) -> Value:
        """A Math node."""
        node = self.node("ShaderNodeMath", operation=operation)
        for socket, operand in zip(node.inputs, operands, strict=False):
            self.plug(socket, operand)
        return Value(self, node.outputs[0])

    def vector_math(self, operation: str, *operands: Any, output: str = "Vector") -> Any:
        """A Vector Math node."""
        node = self.node("ShaderNodeVectorMath", operation=operation)
        for socket, operand in zip(node.inputs, operands, strict=False):
            self.plug(socket, operand)
        return (Value if output == "Value" else Vector)(self, node.outputs[output])

    def combine(self, x: Any = 0.0, y: Any = 0.0, z: Any = 0.0) -> Vector:
        """A vector of three numbers."""
        node = self.node("ShaderNodeCombineXYZ")
        for socket, operand in zip(node.inputs, (x, y, z), strict=True):
            self.plug(socket, operand)
        return Vector(self, node.outputs[0])

    def call(self, group: bpy.types.NodeTree, *arguments: Any) -> list[Any]:
        """A group node: its outputs by position."""
        kind = "GeometryNodeGroup" if group.bl_idname == "GeometryNodeTree" else "ShaderNodeGroup"
        node = self.node(kind, node_tree=group)
        for socket, argument in zip(node.inputs, arguments, strict=False):
            self.plug(socket, argument)
        return [wrap(self, socket) for socket in node.outputs if socket.enabled and socket.name]

    def give(self, exit_node: bpy.types.Node, values: Sequence[Any]) -> None:
        """Connect the outputs of a group, by position."""
        for socket, value in zip(exit_node.inputs, values, strict=False):  # the last one of the node is for a new one
            self.plug(socket, value)


def wrap(tree: Tree, socket: bpy.types.NodeSocket) -> Any:
    """Floats and vectors with their operators, anything else as it is."""
    if socket.type == "VECTOR":
        return Vector(tree, socket)
    return Value(tree, socket) if socket.type in ("VALUE", "INT", "BOOLEAN") else socket


def new_group(name: str, kind: str, inputs: dict[str, str], outputs: dict[str, str]) -> tuple[Tree, list[Any], Any]:
    """(builder, wrapped inputs, output node) of a new node group; sockets as name -> type of socket."""
    group = bpy.data.node_groups.new(name, kind)
    for in_out, sockets in (("INPUT", inputs), ("OUTPUT", outputs)):
        for socket_name, socket_type in sockets.items():
            group.interface.new_socket(socket_name, in_out=in_out, socket_type=socket_type)
    tree = Tree(group)
    entry, exit_node = tree.node("NodeGroupInput"), tree.node("NodeGroupOutput")
    return tree, [wrap(tree, socket) for socket in entry.outputs[: len(inputs)]], exit_node


def arrange(tree: bpy.types.NodeTree) -> None:
    """Lay nodes out in columns by their distance from the inputs, so that people can read the tree."""
    column = dict.fromkeys(tree.nodes, 0)
    order = list(tree.links)
    for _ in range(len(tree.nodes)):
        moved = False
        for link in order:
            if column[link.to_node] <= column[link.from_node]:
                column[link.to_node] = column[link.from_node] + 1
                moved = True
        if not moved:
            break
    rows: dict[int, int] = {}
    places: list[float] = []
    for x in column.values():  # in the order of the nodes
        y = rows[x] = rows.get(x, -1) + 1
        places += 200 * x, -180 * y
    tree.nodes.foreach_set("location", places)  # at once: each alone makes Blender look at the whole tree
