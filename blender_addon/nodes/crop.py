"""The node tree "DoG Splat Crop": splats whose centres are in a box, a sphere or a closed mesh stay.

It is put before the tree that draws, deletes nothing of the object's data, and follows the object that it is given.
"""

from __future__ import annotations

from typing import Any

import bpy

from .builder import Tree, Vector, new_group, wrap
from .geometry import choose, delete, describe, direction_of, has_object
from .groups import GEOMETRY, cached_group, finish_group

NAME = "DoG Splat Crop"
SHAPES = ("Box", "Sphere", "Mesh")
INPUTS = {
    "Geometry": "NodeSocketGeometry", "Shape": "NodeSocketMenu", "Object": "NodeSocketObject",
    "Invert": "NodeSocketBool",
}  # fmt: skip
# No ray of these goes along the edges of what people model. Two of three decide, for meshes with a hole.
RAYS = ((0.171, 0.313, 0.934), (-0.823, 0.291, 0.488), (0.402, -0.897, 0.184))
FAR = 1e6


def crop_tree() -> bpy.types.NodeTree:
    """The tree of this version in this file, made where there is none."""
    if existing := cached_group(NAME):
        return existing
    tree, (geometry, shape, target, invert), exit_node = new_group(
        NAME, GEOMETRY, INPUTS, {"Geometry": "NodeSocketGeometry"}
    )
    info = tree.node("GeometryNodeObjectInfo", transform_space="RELATIVE")
    tree.plug(info.inputs["Object"], target)
    local, has_room = _in_space_of(tree, info)
    x, y, z = (tree.math("ABSOLUTE", part) for part in local.split())
    box = 1.0 - (tree.math("MAXIMUM", tree.math("MAXIMUM", x, y), z) > 1.0)
    sphere = 1.0 - (local.dot(local) > 1.0)
    inside = choose(tree, "FLOAT", shape, dict(zip(SHAPES, (box, sphere, _inside(tree, info)), strict=True)))
    lost = tree.math("ABSOLUTE", 1.0 - inside * has_room - invert)
    tree.give(exit_node, [delete(tree, geometry, lost * has_object(info))])
    describe(tree.tree, {
        "Shape": {"default_value": SHAPES[0], "description": "Box and Sphere are the cube from -1 to 1 and the unit "
                  "sphere, moved, turned and scaled as the object; Mesh is the inside of a closed mesh"},
        "Object": {"description": "Its place is where splats stay; without one nothing is cropped"},
        "Invert": {"description": "Show what is outside instead"},
    })  # fmt: skip
    return finish_group(tree, NAME)


def _in_space_of(tree: Tree, info: bpy.types.Node) -> tuple[Vector, Any]:
    """(Positions as the object of ``info`` sees them, 1 unless it is flat or a point, which sees none)."""
    inverse, moved = tree.node("FunctionNodeInvertMatrix"), tree.node("FunctionNodeTransformPoint")
    tree.plug(inverse.inputs[0], info.outputs["Transform"])
    tree.plug(moved.inputs["Vector"], tree.node("GeometryNodeInputPosition").outputs[0])
    tree.plug(moved.inputs["Transform"], inverse.outputs[0])
    return Vector(tree, moved.outputs[0]), wrap(tree, inverse.outputs["Invertible"])


def _inside(tree: Tree, info: bpy.types.Node) -> Any:
    """1 where most rays leave the mesh through the back of a face."""
    votes = None
    x, y, z = (direction_of(info, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    side = tree.math("SIGN", x.dot(y.cross(z)))  # a mirror turns the faces round
    for direction in RAYS:
        ray = tree.node("GeometryNodeRaycast")
        for name, value in (("Target Geometry", info.outputs["Geometry"]), ("Ray Direction", direction),
                            ("Ray Length", FAR)):  # fmt: skip
            tree.plug(ray.inputs[name], value)
        leaves = wrap(tree, ray.outputs["Hit Normal"]).dot(direction) * side > 0.0
        vote = wrap(tree, ray.outputs["Is Hit"]) * leaves
        votes = vote if votes is None else votes + vote
    assert votes is not None
    return votes > 1.5
