"""Node groups of this version of the add-on in a file, and what several of them are made of."""

from __future__ import annotations

from typing import Any

import bpy

from .builder import Tree, Value, arrange, wrap
from .material import VERSION

LOW_PASS = 0.3  # px², so that no splat falls between the pixels, as in 3DGS
NEAREST_LEVEL = 255.0  # opacities below 1/255 are not seen
GEOMETRY = "GeometryNodeTree"
SPACE = "dogsplat_space"  # of a group: the working space that it is for; without one it is Linear Rec.709
RADIANCE = ", radiance"  # ends the name of the space where the group is for linear models


def cached_group(name: str, space: str = "") -> bpy.types.NodeTree | None:
    """The group of that name, of this version and for that working space (``space.py``), if the file has it."""
    return next((g for g in bpy.data.node_groups
                 if is_current(g, name) and g.get(SPACE, "") == space and not g.library), None)  # fmt: skip


def is_current(group: bpy.types.NodeTree, name: str) -> bool:
    """Whether it is the group of that name as this version makes it."""
    return group.get("dogsplat") == f"{name} {VERSION}"


def version_of(group: bpy.types.NodeTree) -> int:
    """The version of the add-on's trees that one of ours is of."""
    return int(group["dogsplat"].rpartition(" ")[2])


def finish_group(tree: Tree, name: str, space: str = "") -> bpy.types.NodeTree:
    """Lay out a new group and mark it, so that it is found again."""
    arrange(tree.tree)
    tree.tree["dogsplat"] = f"{name} {VERSION}"
    if space:
        tree.tree[SPACE] = space
    return tree.tree


def named_attribute(tree: Tree, name: Any, kind: str = "FLOAT_VECTOR"):
    """A Named Attribute node: a float, a vector, or the socket as it is for colours and rotations.

    Its name is a constant or a socket.
    """
    return wrap(tree, attribute_socket(tree, name, kind))


def attribute_socket(tree: Tree, name: Any, kind: str) -> bpy.types.NodeSocket:
    """The output of a Named Attribute node."""
    node = tree.node("GeometryNodeInputNamedAttribute", data_type=kind)
    tree.plug(node.inputs["Name"], name)
    return node.outputs["Attribute"]


def cutoff(tree: Tree, opacity: Value) -> Value:
    """r² at which opacity exp(-r² / 2) falls to 1/255; 0 where it never exceeds that."""
    level = tree.math("MAXIMUM", opacity * NEAREST_LEVEL, 1.0)
    return tree.math("LOGARITHM", level, 2.718281828459045) * 2.0
