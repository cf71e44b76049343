"""The node group of the quads: one rectangle per splat, at its depth and parallel to the image plane of a pose.

It carries the EWA kernel of 3DGS, low-pass filter included. In a render quads are drawn in the order of the depth of
their centres.
"""

from __future__ import annotations

from typing import Any

import bpy

from .builder import Tree, Value, Vector, new_group, wrap
from .fields import FRAME, Frame, Splat
from .geometry import delete, remove, set_material, sort, store
from .groups import GEOMETRY, LOW_PASS, cached_group, cutoff, finish_group, named_attribute
from .material import EXTENT, KERNEL, OPACITIES, PSEUDO, quad_material

CORNER = "splat:corner"
APART = 1e-6  # of their depth, that quads are at least
INPUTS = {
    "Points": "NodeSocketGeometry", "DoG": "NodeSocketBool", "Near Clip": "NodeSocketFloat",
    "Antialiased": "NodeSocketBool", **FRAME,
}  # fmt: skip


def quads_group() -> bpy.types.NodeTree:
    """A mesh of a rectangle per visible splat, the farthest first."""
    name = "DoG Splat quads"
    if existing := cached_group(name):
        return existing
    tree, (points, dog, near, antialiased, *of_frame), exit_node = new_group(
        name, GEOMETRY, INPUTS, {"Quads": "NodeSocketGeometry"}
    )
    frame, splat = Frame(*of_frame), Splat(tree, dog)
    rows = _projected_axes(tree, frame, splat)
    primary = tree.call(kernel_group(), *(row * splat.scale for row in rows), splat.opacity, antialiased)
    pseudo = tree.call(kernel_group(), *(row * splat.pseudo_scale for row in rows), splat.pseudo_opacity, antialiased)
    half_x, half_y, _ = primary[1].maximum(pseudo[1]).split()

    visible = (frame.depth > near) * (half_x > 0.0)
    points = delete(tree, points, 1.0 - visible)
    values = {EXTENT: tree.combine(half_x, half_y, frame.distance), KERNEL: primary[0], PSEUDO: pseudo[0],
              OPACITIES: tree.combine(primary[2], pseudo[2])}  # fmt: skip
    for attribute, value in values.items():
        points = store(tree, points, attribute, value)
    for pattern in ("radiance:*", "dog:*"):
        points = remove(tree, points, pattern)
    tree.give(exit_node, [set_material(tree, _rectangles(tree, points, frame), quad_material())])
    return finish_group(tree, name)


def _projected_axes(tree: Tree, frame: Frame, splat: Splat) -> list[Vector]:
    """Rows of J W R: what the axes of a splat are on the image plane, in pixels."""
    inverse = tree.node("FunctionNodeInvertRotation")
    tree.plug(inverse.inputs[0], splat.rotation)
    rows = []
    for axis, tangent, f in zip((frame.right, frame.down), frame.tangents.split(), frame.focal.split(), strict=False):
        turn = tree.node("FunctionNodeRotateVector")
        tree.plug(turn.inputs["Vector"], (axis - frame.forward * tangent) * (f / frame.distance))
        tree.plug(turn.inputs["Rotation"], inverse.outputs[0])
        rows.append(Vector(tree, turn.outputs[0]))
    return rows


def _rectangles(tree: Tree, points: Any, frame: Frame) -> Any:
    """Points with kernels as rectangles, the farthest first; their corners have what the kernels are of."""
    corner_x, corner_y, _ = named_attribute(tree, CORNER).split()
    size_x, size_y, distance = named_attribute(tree, EXTENT).split()
    place = tree.node("GeometryNodeInstanceOnPoints")
    tree.plug(place.inputs["Points"], _sorted(tree, points, frame))
    tree.plug(place.inputs["Instance"], _corners(tree))
    tree.plug(place.inputs["Scale"], (0.0, 0.0, 0.0))
    realize = tree.node("GeometryNodeRealizeInstances")
    tree.plug(realize.inputs[0], place.outputs[0])

    fx, fy, _ = frame.focal.split()
    spread = tree.node("GeometryNodeSetPosition")
    tree.plug(spread.inputs["Geometry"], realize.outputs[0])
    steps = corner_x * size_x * distance / fx, corner_y * size_y * distance / fy
    tree.plug(spread.inputs["Offset"], frame.across * steps[0] + frame.up * steps[1])
    mesh = spread.outputs[0]
    dx, dy = size_x * corner_x, size_y * corner_y * -1.0  # pixels, y down
    opacities = named_attribute(tree, OPACITIES).split()
    for name, opacity in zip((KERNEL, PSEUDO), opacities[:2], strict=True):
        ux, uy, vy = named_attribute(tree, name).split()
        mesh = store(tree, mesh, name, tree.combine(ux * dx + uy * dy, vy * dy, opacity))
    for name in (CORNER, EXTENT, OPACITIES):
        mesh = remove(tree, mesh, name)
    return mesh


def _sorted(tree: Tree, points: Any, frame: Frame) -> Any:
    """The farthest point first; of those at one depth the last, as in the package.

    Each that is as deep as the one before is moved a little nearer than that, in the same pixels: Cycles passes over
    one of two quads at the same depth. Those of a flat model that is seen from the front all have the same.
    """
    index = wrap(tree, tree.node("GeometryNodeInputIndex").outputs[0])
    points = sort(tree, sort(tree, points, index * -1.0), frame.depth * -1.0)
    before = tree.node("GeometryNodeFieldAtIndex", data_type="FLOAT", domain="POINT")
    tree.plug(before.inputs["Index"], tree.math("MAXIMUM", index - 1.0, 0.0))
    tree.plug(before.inputs["Value"], frame.depth)
    size = tree.math("ABSOLUTE", frame.depth)
    close = (wrap(tree, before.outputs[0]) - frame.depth < size * APART) * (index > 0.5)
    rank = _running_sum(tree, close, _running_sum(tree, 1.0 - close))  # among neighbours that are close
    move = tree.node("GeometryNodeSetPosition")
    tree.plug(move.inputs["Geometry"], points)
    tree.plug(move.inputs["Offset"], frame.direction * (size / frame.distance * rank * -APART))
    return move.outputs[0]


def _running_sum(tree: Tree, value: Value, group: Value | None = None) -> Value:
    """Of the values of the points up to each, of its group alone."""
    node = tree.node("GeometryNodeAccumulateField", data_type="FLOAT", domain="POINT")
    tree.plug(node.inputs["Value"], value)
    tree.plug(node.inputs["Group ID"], group)
    return Value(tree, node.outputs["Leading"])


def _corners(tree: Tree) -> Any:
    """The rectangle from (-1, -1) to (1, 1), its corners stored as attribute."""
    grid = tree.node("GeometryNodeMeshGrid")
    for name, value in (("Size X", 2.0), ("Size Y", 2.0), ("Vertices X", 2), ("Vertices Y", 2)):
        grid.inputs[name].default_value = value
    position = Vector(tree, tree.node("GeometryNodeInputPosition").outputs[0])
    return store(tree, grid.outputs[0], CORNER, position)


def kernel_group() -> bpy.types.NodeTree:
    """The 2D kernel of scaled axes that project to the columns of the rows V0, V1 (pixels).

    Σ' = V Vᵀ + 0.3 I; the kernel at offset (dx, dy) from its centre is exp(-(u² + v²) / 2) with u = ux dx + uy dy and
    v = vy dy. "Extent" is half the size of the box (x, y) outside of which opacity times kernel is below 1/255.
    """
    name = "DoG Splat kernel"
    if existing := cached_group(name):
        return existing
    sockets = {"V0": "NodeSocketVector", "V1": "NodeSocketVector", "Opacity": "NodeSocketFloat",
               "Antialiased": "NodeSocketBool"}  # fmt: skip
    results = {"Kernel": "NodeSocketVector", "Extent": "NodeSocketVector", "Opacity": "NodeSocketFloat"}
    tree, (v0, v1, opacity, antialiased), exit_node = new_group(name, GEOMETRY, sockets, results)
    raw_xx, raw_yy, xy, minors = v0.dot(v0), v1.dot(v1), v0.dot(v1), v0.cross(v1)
    raw_det = minors.dot(minors)  # Cauchy-Binet: xx yy - xy² would cancel on needles
    det = raw_det + (raw_xx + raw_yy) * LOW_PASS + LOW_PASS**2
    xx, yy = raw_xx + LOW_PASS, raw_yy + LOW_PASS
    ux = tree.math("SQRT", yy / det)
    uy = ux * xy / yy * -1.0
    vy = 1.0 / tree.math("SQRT", yy)
    shrunk = tree.math("SQRT", tree.math("MAXIMUM", raw_det / det, 2.5e-5)) - 1.0
    opacity = opacity * (shrunk * antialiased + 1.0)
    t = cutoff(tree, opacity)
    extent = tree.combine(tree.math("SQRT", t * xx), tree.math("SQRT", t * yy))
    tree.give(exit_node, [tree.combine(ux, uy, vy), extent, opacity])
    return finish_group(tree, name)
