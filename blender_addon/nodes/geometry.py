"""Nodes that take a geometry and give one, and what the interface of a tree says of its inputs."""

from __future__ import annotations

from typing import Any

import bpy

from .builder import Tree, Value, Vector, wrap


def store(tree: Tree, geometry: Any, name: Any, value: Any, kind: str = "FLOAT_VECTOR", where: Any = None) -> Any:
    """The points with an attribute; where the selection is false, it stays as it is."""
    node = tree.node("GeometryNodeStoreNamedAttribute", data_type=kind, domain="POINT")
    for socket, given in (("Geometry", geometry), ("Selection", where), ("Name", name), ("Value", value)):
        tree.plug(node.inputs[socket], given)
    return node.outputs[0]


def remove(tree: Tree, geometry: Any, pattern: str) -> Any:
    """Without the attributes whose names match."""
    node = tree.node("GeometryNodeRemoveAttribute")
    if hasattr(node, "pattern_mode"):
        node.pattern_mode = "WILDCARD"
    else:
        node.inputs["Pattern Mode"].default_value = "Wildcard"
    tree.plug(node.inputs["Geometry"], geometry)
    tree.plug(node.inputs["Name"], pattern)
    return node.outputs[0]


def delete(tree: Tree, geometry: Any, selection: Value) -> Any:
    """Without the points where ``selection`` is true."""
    node = tree.node("GeometryNodeDeleteGeometry", domain="POINT")
    tree.plug(node.inputs["Geometry"], geometry)
    tree.plug(node.inputs["Selection"], selection > 0.5)
    return node.outputs[0]


def sort(tree: Tree, geometry: Any, weight: Value) -> Any:
    """The points in the order of ``weight``, the smallest first; the order of equal ones stays."""
    node = tree.node("GeometryNodeSortElements", domain="POINT")
    tree.plug(node.inputs["Geometry"], geometry)
    tree.plug(node.inputs["Sort Weight"], weight)
    return node.outputs[0]


def set_material(tree: Tree, geometry: Any, material: bpy.types.Material) -> Any:
    """The geometry in a material."""
    node = tree.node("GeometryNodeSetMaterial")
    tree.plug(node.inputs["Geometry"], geometry)
    node.inputs["Material"].default_value = material
    return node.outputs[0]


def switch(tree: Tree, kind: str, condition: Any, otherwise: Any, then: Any) -> Any:
    """``then`` where the condition is true; of two geometries only the one that is wanted is made."""
    node = tree.node("GeometryNodeSwitch", input_type=kind)
    for socket, value in zip(node.inputs, (condition, otherwise, then), strict=True):
        tree.plug(socket, value)
    return wrap(tree, node.outputs[0])


def choose(tree: Tree, kind: str, menu: Any, choices: dict[str, Any]) -> Any:
    """A menu; the numbers of its items are 0, 1, … in their order."""
    node = tree.node("GeometryNodeMenuSwitch", data_type=kind)
    for i, name in enumerate(choices):  # the node comes with two items, whose numbers are 0 and 1
        item = node.enum_items[i] if i < len(node.enum_items) else node.enum_items.new(name)
        item.name = name
    tree.plug(node.inputs[0], menu)
    for name, value in choices.items():
        tree.plug(node.inputs[name], value)
    return wrap(tree, node.outputs[0])


def has_attribute(tree: Tree, geometry: Any, name: Any, kind: str = "FLOAT_VECTOR") -> Any:
    """Whether the points have the attribute: one value, as a switch of geometries needs it."""
    attribute = tree.node("GeometryNodeInputNamedAttribute", data_type=kind)
    tree.plug(attribute.inputs["Name"], name)
    sample = tree.node("GeometryNodeSampleIndex", data_type="BOOLEAN", domain="POINT")
    for socket, value in (("Geometry", geometry), ("Value", attribute.outputs["Exists"]), ("Index", 0)):
        tree.plug(sample.inputs[socket], value)
    return wrap(tree, sample.outputs[0])


def has_object(info: bpy.types.Node) -> Any:
    """Field of an Object Info node: 1 where an object is chosen, even one that is scaled to nothing.

    Without one the scale is zero and the transform the identity.
    """
    tree = Tree(info.id_data)
    scale, axis = wrap(tree, info.outputs["Scale"]), direction_of(info, (1.0, 0.0, 0.0))
    return tree.math("MAXIMUM", scale.dot(scale) > 0.0, axis.dot(axis) < 0.5)


def direction_of(info: bpy.types.Node, direction: tuple[float, float, float]) -> Vector:
    """A direction in the space of the object of an Object Info node, in that of the one that has the modifier."""
    tree = Tree(info.id_data)
    moved = tree.node("FunctionNodeTransformDirection")
    tree.plug(moved.inputs["Direction"], direction)
    tree.plug(moved.inputs["Transform"], info.outputs["Transform"])
    return Vector(tree, moved.outputs[0])


def describe(group: bpy.types.NodeTree, settings: dict[str, dict[str, Any]], hidden: tuple[str, ...] = ()) -> None:
    """Defaults, ranges and tooltips of the inputs; ``hidden`` ones are left out of the modifier's panel."""
    for item in group.interface.items_tree:
        if item.item_type != "SOCKET" or item.in_out != "INPUT":
            continue
        for name, value in settings.get(item.name, {}).items():
            setattr(item, name, value)
        item.hide_in_modifier = item.name in hidden
