"""The node tree "DoG Splat Paint": painted splats are erased, or their colours multiplied.

Blender's brushes paint on faces, which a splat has not. So they paint a stand-in, a tetrahedron per splat
(``editing/stand_in.py``), and this tree reads it while it is there; afterwards it reads the attributes of the splats.
What it has made real it takes off: applied, by us or by Blender, it leaves nothing that would be done once more.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ..files.sh import C0
from ..objects.attributes import BASE, CURVATURE_VECTORS, ERASE, PAINT_INDEX, PAINT_OWNER, SH, SLOPE_VECTORS, TINT
from ..objects.working_space import working_matrix
from .builder import Tree, Value, Vector, new_group, wrap
from .color import linear_to_srgb, multiplied
from .geometry import delete, describe, has_attribute, has_object, remove, store, switch
from .groups import GEOMETRY, attribute_socket, cached_group, finish_group, named_attribute

NAME = "DoG Splat Paint"
CORNERS = 4  # of the stand-in of a splat
WEIGHT = "weight"
INPUTS = {
    "Geometry": "NodeSocketGeometry", "Erase": "NodeSocketBool", "Threshold": "NodeSocketFloat",
    "Tint": "NodeSocketBool", "Stand-In": "NodeSocketObject",
    "Linear Light": "NodeSocketBool",
}  # fmt: skip


def paint_tree(space: str = "") -> bpy.types.NodeTree:
    """The tree of this version for that working space in this file, made where there is none."""
    if existing := cached_group(NAME, space):
        return existing
    tree, inputs, exit_node = new_group(NAME, GEOMETRY, INPUTS, {"Geometry": "NodeSocketGeometry"})
    geometry, erase, threshold, tint, target, linear = inputs
    info = tree.node("GeometryNodeObjectInfo", transform_space="ORIGINAL")
    tree.plug(info.inputs["Object"], target)
    (weight,) = _painted(tree, info, ERASE, "FLOAT")
    kept = delete(tree, geometry, (weight > threshold) * erase)
    painted = tree.math("MAXIMUM", has_object(info), has_attribute(tree, kept, TINT, "FLOAT_COLOR"))
    color, strength = _painted(tree, info, TINT, "FLOAT_COLOR")
    tinted = _tinted(tree, kept, color, strength, linear, space)
    points = switch(tree, "GEOMETRY", tint * painted > 0.5, kept, tinted)
    for name, kind, done in ((ERASE, "FLOAT", erase), (TINT, "FLOAT_COLOR", tint)):
        there = has_attribute(tree, points, name, kind)  # Blender warns where nothing is to be removed
        points = switch(tree, "GEOMETRY", done * there > 0.5, points, remove(tree, points, name))
    tree.give(exit_node, [points])
    describe(tree.tree, {
        "Erase": {"default_value": True, "description": f'Leave out the splats whose weight "{ERASE}" is high'},
        "Threshold": {"default_value": 0.5, "min_value": 0.0, "max_value": 1.0, "subtype": "FACTOR",
                      "description": "Splats of a higher weight are left out"},
        "Tint": {"default_value": True, "description": f'Multiply the colors by the painted ones, "{TINT}"'},
        "Stand-In": {"description": "The object that is painted; without one, the attributes of the splats hold"},
        "Linear Light": {"default_value": False, "description": "The colors are radiance, not sRGB values"},
    })  # fmt: skip
    return finish_group(tree, NAME, space)


def weights_tree(group: str) -> bpy.types.NodeTree:
    """A tree that stores the weights of a vertex group as the attribute ``WEIGHT``, which Python reads at once."""
    sockets = {"Geometry": "NodeSocketGeometry"}
    tree, (geometry,), exit_node = new_group("DoG Splat weights", GEOMETRY, sockets, sockets)
    weights = named_attribute(tree, group, "FLOAT")
    tree.give(exit_node, [store(tree, geometry, WEIGHT, weights, "FLOAT")])
    return tree.tree


def _painted(tree: Tree, info: bpy.types.Node, name: str, kind: str) -> list[Any]:
    """What is painted: the mean over the corners of the stand-in, or else the value of the splat itself.

    A list of one number, or of a colour as a vector and its alpha.
    """
    own = attribute_socket(tree, name, kind)
    first = named_attribute(tree, PAINT_INDEX, "INT") * float(CORNERS)
    totals: list[Any] = []
    for corner in range(CORNERS):
        parts = _parts(tree, _at(tree, info, own, kind, first + float(corner)))
        totals = [total + part for total, part in zip(totals, parts, strict=True)] if totals else parts
    kinds = ["VECTOR", "FLOAT"] if kind == "FLOAT_COLOR" else ["FLOAT"]
    owner = attribute_socket(tree, PAINT_OWNER, "INT")
    other = tree.math("ABSOLUTE", wrap(tree, owner) - wrap(tree, _at(tree, info, owner, "INT", first)))
    chosen = has_object(info) * (other < 0.5)  # splats that were joined are in no stand-in, or in another one
    return [
        switch(tree, part_kind, chosen, mine, total * (1 / CORNERS))
        for part_kind, mine, total in zip(kinds, _parts(tree, own), totals, strict=True)
    ]


def _at(tree: Tree, info: bpy.types.Node, field: bpy.types.NodeSocket, kind: str, index: Value) -> Any:
    """A field as the point of that index of the stand-in has it."""
    sample = tree.node("GeometryNodeSampleIndex", data_type=kind, domain="POINT")
    for name, value in (("Geometry", info.outputs["Geometry"]), ("Value", field), ("Index", index)):
        tree.plug(sample.inputs[name], value)
    return sample.outputs[0]


def _parts(tree: Tree, socket: Any) -> list[Any]:
    if socket.type != "RGBA":
        return [wrap(tree, socket)]
    channels = tree.node("FunctionNodeSeparateColor")
    tree.plug(channels.inputs[0], socket)
    return [Vector(tree, socket), Value(tree, channels.outputs["Alpha"])]


def _tinted(tree: Tree, points: Any, color: Vector, strength: Value, linear: Value, space: str) -> Any:
    """Colours times the tint as it is seen: c = 1/2 + C0 dc + … becomes t c. What is not tinted keeps its bits.

    A brightness of all channels cannot have the hue of the tint: it is multiplied by the mean, which is nearest.
    """
    distance = tree.vector_math("DISTANCE", color, (1.0, 1.0, 1.0), output="Value")  # white in every space
    tinted = strength * distance > 0.0
    if space:
        color = multiplied(tree, color, np.linalg.inv(working_matrix())).maximum((0.0, 0.0, 0.0))
    seen = switch(tree, "VECTOR", linear, linear_to_srgb(tree, color), color)
    factor = (seen + (-1.0, -1.0, -1.0)) * strength + (1.0, 1.0, 1.0)
    base, alpha = _parts(tree, attribute_socket(tree, BASE, "FLOAT_COLOR"))
    dc = base * factor + (factor + (-1.0, -1.0, -1.0)) * (0.5 / C0)
    joined = tree.node("FunctionNodeCombineColor")
    for socket, value in zip(joined.inputs, (*dc.split(), alpha), strict=True):
        tree.plug(socket, value)
    points = store(tree, points, BASE, joined.outputs[0], "FLOAT_COLOR", tinted)
    factors = dict.fromkeys((*(SH.format(k) for k in range(15)), *SLOPE_VECTORS), factor)
    factors |= dict.fromkeys(CURVATURE_VECTORS, factor.dot((1 / 3, 1 / 3, 1 / 3)))
    for name, times in factors.items():
        (points,) = tree.call(_multiply_group(), points, name, times, tinted)
    return points


def _multiply_group() -> bpy.types.NodeTree:
    """The points with an attribute multiplied where the selection is true, if they have it."""
    name = "DoG Splat multiply"
    if existing := cached_group(name):
        return existing
    sockets = {"Points": "NodeSocketGeometry", "Name": "NodeSocketString", "Factor": "NodeSocketVector",
               "Selection": "NodeSocketBool"}  # fmt: skip
    tree, (points, attribute, factor, selection), exit_node = new_group(
        name, GEOMETRY, sockets, {"Points": "NodeSocketGeometry"}
    )
    changed = store(tree, points, attribute, named_attribute(tree, attribute) * factor, where=selection)
    tree.give(exit_node, [switch(tree, "GEOMETRY", has_attribute(tree, points, attribute), points, changed)])
    return finish_group(tree, name)
