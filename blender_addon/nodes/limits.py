"""The node tree "DoG Splat Limits": sliders for the opacity, the size and the number of splats that stay."""

from __future__ import annotations

from typing import Any

import bpy

from ..objects.attributes import SCALE
from .builder import Tree, Value, new_group, wrap
from .fields import importance, opacity
from .geometry import choose, delete, describe, remove, sort, store, switch
from .groups import GEOMETRY, cached_group, finish_group, named_attribute

NAME = "DoG Splat Limits"
ORDERS = ("Importance", "Opacity")
ORDER = "splat:order"
INPUTS = {
    "Geometry": "NodeSocketGeometry", "Minimum Opacity": "NodeSocketFloat", "Minimum Size": "NodeSocketFloat",
    "Maximum Size": "NodeSocketFloat", "Maximum Count": "NodeSocketInt", "Count By": "NodeSocketMenu",
}  # fmt: skip


def limits_tree() -> bpy.types.NodeTree:
    """The tree of this version in this file, made where there is none."""
    if existing := cached_group(NAME):
        return existing
    tree, inputs, exit_node = new_group(NAME, GEOMETRY, INPUTS, {"Geometry": "NodeSocketGeometry"})
    geometry, least_opacity, least, most, count, order = inputs
    x, y, z = named_attribute(tree, SCALE).split()
    size = tree.math("MAXIMUM", tree.math("MAXIMUM", x, y), z)
    too_large = (size > most) * (most > 0.0)
    few = delete(tree, geometry, (opacity(tree) < least_opacity) + (size < least) + too_large)
    weight = choose(tree, "FLOAT", order, dict(zip(ORDERS, (importance(tree), opacity(tree)), strict=True)))
    tree.give(exit_node, [switch(tree, "GEOMETRY", count > 0.5, few, _first(tree, few, weight, count))])
    length = {"min_value": 0.0, "subtype": "DISTANCE"}
    describe(tree.tree, {
        "Minimum Opacity": {"min_value": 0.0, "max_value": 1.0, "subtype": "FACTOR",
                            "description": "Splats of a lower opacity are left out"},
        "Minimum Size": {**length, "description": "Splats whose longest axis has a smaller standard deviation are "
                         "left out"},
        "Maximum Size": {**length, "description": "Splats whose longest axis has a larger standard deviation are "
                         "left out; 0: none are"},
        "Maximum Count": {"min_value": 0, "description": "So many splats stay, the first by the order below; 0: all"},
        "Count By": {"default_value": ORDERS[0], "description": "Importance is opacity times the area of the "
                     "largest cross-section"},
    })  # fmt: skip
    return finish_group(tree, NAME)


def _first(tree: Tree, points: Any, weight: Value, count: Value) -> Any:
    """The ``count`` points of the greatest weight, in the order in which they came."""
    index = wrap(tree, tree.node("GeometryNodeInputIndex").outputs[0])
    ordered = sort(tree, store(tree, points, ORDER, index, "INT"), weight * -1.0)
    kept = delete(tree, ordered, 1.0 - (index < count))
    return remove(tree, sort(tree, kept, named_attribute(tree, ORDER, "INT")), ORDER)
