"""The Geometry Nodes tree of a model: from points with attributes to what the engines render.

Three ways to show a model, and "Automatic", which is quads in renders and ellipsoids in the viewport:

- Quads: one rectangle per splat, at its depth and parallel to the image plane of the active camera, carrying the EWA
  kernel of 3DGS (low-pass filter included). In a render they are drawn in the order of the depth of their centres.
  This is the image formation of the ``dogsplat`` integrator: exact for the active camera, meaningless from elsewhere.
- Ellipsoids: instanced spheres whose material evaluates the kernel along the ray; right from everywhere.
- Points: opaque, fast.

Viewports may show a share of the splats, the most important ones, and take the place of the camera (``viewport/``).
"""

from __future__ import annotations

from typing import Any

import bpy

from ..objects.attributes import RANK
from .builder import Tree, Value, Vector, new_group, wrap
from .fields import Frame, Pose, Splat, camera_pose
from .geometry import choose, delete, describe, remove, set_material, sort, store, switch
from .groups import (
    GEOMETRY,
    LOW_PASS,
    cached_group,
    color_group,
    cutoff,
    finish_group,
    kernel_group,
    named_attribute,
)
from .material import (
    COLOR,
    EXTENT,
    FACTOR,
    KERNEL,
    OPACITIES,
    PSEUDO,
    ellipsoid_material,
    point_material,
    quad_material,
)

NAME = "DoG Splat"
SHOW = ("Automatic", "Quads", "Ellipsoids", "Points")
CAMERA_INPUTS = ("Focal X", "Focal Y", "Center X", "Center Y", "Width", "Height")  # driven, pixels
VIEW_INPUTS = ("Moving Share", "Moving Points", "View", "View Location", "View Rotation", "View Focal", "View Center",
               "View Size")  # fmt: skip
NEAR_CLIP = 0.2  # of models whose files say nothing
SPHERE_RADIUS = 1 / 0.9339  # of an icosphere with 80 faces that holds the unit sphere
CORNER = "splat:corner"
INPUTS = {
    "Geometry": "NodeSocketGeometry", "Show As": "NodeSocketMenu", "SH Degree": "NodeSocketInt",
    "DoG": "NodeSocketBool", "Linear Colors": "NodeSocketBool", "Antialiased": "NodeSocketBool",
    "Near Clip": "NodeSocketFloat", **dict.fromkeys(CAMERA_INPUTS, "NodeSocketFloat"),
    "Viewport Share": "NodeSocketFloat", "Moving Share": "NodeSocketFloat", "Moving Points": "NodeSocketBool",
    "View": "NodeSocketBool", "View Location": "NodeSocketVector", "View Rotation": "NodeSocketRotation",
    **dict.fromkeys(VIEW_INPUTS[5:], "NodeSocketVector"),
}  # fmt: skip


def splat_tree(space: str = "") -> bpy.types.NodeTree:
    """The tree of this version for that working space in this file, made where there is none."""
    if existing := cached_group(NAME, space):
        return existing
    tree, inputs, exit_node = new_group(NAME, GEOMETRY, INPUTS, {"Geometry": "NodeSocketGeometry"})
    geometry, show, degree, dog, linear, antialiased, near, fx, fy, cx, cy, width, height, *of_view = inputs
    share, moving_share, moving_points, view, *view_numbers = of_view
    in_viewport = wrap(tree, tree.node("GeometryNodeIsViewport").outputs[0])
    of_camera = (*camera_pose(tree), tree.combine(fx, fy), tree.combine(cx, cy), tree.combine(width, height))
    kinds = ("VECTOR", "ROTATION", "VECTOR", "VECTOR", "VECTOR")
    pose = Pose(*(switch(tree, kind, view * in_viewport, camera, own)
                  for kind, camera, own in zip(kinds, of_camera, view_numbers, strict=True)))  # fmt: skip
    frame = Frame(tree, pose)
    splat = Splat(tree, dog)

    to_points = tree.node("GeometryNodeMeshToPoints")
    tree.plug(to_points.inputs[0], geometry)
    shown = share * moving_share
    important = delete(tree, to_points.outputs[0], 1.0 - (named_attribute(tree, RANK, "FLOAT") < shown))
    some = switch(tree, "GEOMETRY", in_viewport * (shown < 1.0) > 0.5, to_points.outputs[0], important)
    (color,) = tree.call(color_group(space), frame.direction, degree, linear)
    points = store(tree, some, COLOR, color)
    quads = _quads(tree, points, frame, splat, near, antialiased)
    ellipsoids = _ellipsoids(tree, points, frame, splat, near)
    automatic = switch(tree, "GEOMETRY", in_viewport * (1.0 - view) > 0.5, quads, ellipsoids)
    as_points = _points(tree, points, splat)
    ways = (automatic, quads, ellipsoids, as_points)
    chosen = choose(tree, "GEOMETRY", show, dict(zip(SHOW, ways, strict=True)))
    result = switch(tree, "GEOMETRY", in_viewport * moving_points > 0.5, chosen, as_points)
    tree.plug(exit_node.inputs[0], result)
    _describe(tree.tree)
    return finish_group(tree, NAME, space)


def _quads(tree: Tree, points: Any, frame: Frame, splat: Splat, near: Value, antialiased: Value) -> Any:
    """A mesh of a rectangle per visible splat, the farthest first."""
    rows = _projected_axes(tree, frame, splat)
    primary = tree.call(kernel_group(), *(row * splat.scale for row in rows), splat.opacity, antialiased)
    pseudo = tree.call(kernel_group(), *(row * splat.pseudo_scale for row in rows), splat.pseudo_opacity, antialiased)
    half_x, half_y, _ = primary[1].maximum(pseudo[1]).split()

    visible = (frame.depth > near) * (half_x > 0.0)
    points = delete(tree, points, 1.0 - visible)
    values = {EXTENT: tree.combine(half_x, half_y, frame.depth), KERNEL: primary[0], PSEUDO: pseudo[0],
              OPACITIES: tree.combine(primary[2], pseudo[2])}  # fmt: skip
    for name, value in values.items():
        points = store(tree, points, name, value)
    for pattern in ("radiance:*", "dog:*"):
        points = remove(tree, points, pattern)
    return set_material(tree, _rectangles(tree, points, frame), quad_material())


def _projected_axes(tree: Tree, frame: Frame, splat: Splat) -> list[Vector]:
    """Rows of J W R: what the axes of a splat are on the image plane, in pixels."""
    inverse = tree.node("FunctionNodeInvertRotation")
    tree.plug(inverse.inputs[0], splat.rotation)
    rows = []
    for axis, tangent, f in zip((frame.right, frame.down), frame.tangents, frame.focal, strict=True):
        turn = tree.node("FunctionNodeRotateVector")
        tree.plug(turn.inputs["Vector"], (axis - frame.forward * tangent) * (f / frame.depth))
        tree.plug(turn.inputs["Rotation"], inverse.outputs[0])
        rows.append(Vector(tree, turn.outputs[0]))
    return rows


def _rectangles(tree: Tree, points: Any, frame: Frame) -> Any:
    """Points with kernels as rectangles, the farthest first; their corners have what the kernels are of."""
    corner_x, corner_y, _ = named_attribute(tree, CORNER).split()
    size_x, size_y, depth = named_attribute(tree, EXTENT).split()
    place = tree.node("GeometryNodeInstanceOnPoints")
    tree.plug(place.inputs["Points"], sort(tree, points, depth * -1.0))
    tree.plug(place.inputs["Instance"], _corners(tree))
    tree.plug(place.inputs["Scale"], (0.0, 0.0, 0.0))
    realize = tree.node("GeometryNodeRealizeInstances")
    tree.plug(realize.inputs[0], place.outputs[0])

    fx, fy = frame.focal
    spread = tree.node("GeometryNodeSetPosition")
    tree.plug(spread.inputs["Geometry"], realize.outputs[0])
    right, up = frame.across * (corner_x * size_x * depth / fx), frame.up * (corner_y * size_y * depth / fy)
    tree.plug(spread.inputs["Offset"], right + up)
    mesh = spread.outputs[0]
    dx, dy = size_x * corner_x, size_y * corner_y * -1.0  # pixels, y down
    opacities = named_attribute(tree, OPACITIES).split()
    for name, opacity in zip((KERNEL, PSEUDO), opacities[:2], strict=True):
        ux, uy, vy = named_attribute(tree, name).split()
        mesh = store(tree, mesh, name, tree.combine(ux * dx + uy * dy, vy * dy, opacity))
    for name in (CORNER, EXTENT, OPACITIES):
        mesh = remove(tree, mesh, name)
    return mesh


def _ellipsoids(tree: Tree, points: Any, frame: Frame, splat: Splat, near: Value) -> Any:
    """A sphere per splat, scaled to where the wider of its kernels ends."""
    distance = tree.math("MAXIMUM", frame.depth, near) / frame.unit
    pixel2 = distance * distance / (frame.focal[0] * frame.focal[1]) * LOW_PASS  # low-pass variance at that depth
    primary, pseudo = (
        tree.combine(*(tree.math("SQRT", s * s + pixel2) for s in scale.split()))
        for scale in (splat.scale, splat.pseudo_scale)
    )
    reach, pseudo_reach = (tree.math("SQRT", cutoff(tree, a)) for a in (splat.opacity, splat.pseudo_opacity))
    size = (primary * reach).maximum(pseudo * pseudo_reach)
    points = delete(tree, points, 1.0 - (reach + pseudo_reach > 0.0))
    values = {EXTENT: size / primary, FACTOR: pseudo / primary,
              OPACITIES: tree.combine(splat.opacity, splat.pseudo_opacity)}  # fmt: skip
    for name, value in values.items():
        points = store(tree, points, name, value)
    sphere = tree.node("GeometryNodeMeshIcoSphere")
    sphere.inputs["Radius"].default_value = SPHERE_RADIUS
    sphere.inputs["Subdivisions"].default_value = 2
    place = tree.node("GeometryNodeInstanceOnPoints")
    tree.plug(place.inputs["Points"], points)
    tree.plug(place.inputs["Instance"], set_material(tree, sphere.outputs[0], ellipsoid_material()))
    tree.plug(place.inputs["Rotation"], splat.rotation)
    tree.plug(place.inputs["Scale"], size)
    return place.outputs[0]


def _points(tree: Tree, points: Any, splat: Splat) -> Any:
    """The point cloud, as large as the splats are on average over the axes."""
    radius = tree.node("GeometryNodeSetPointRadius")
    tree.plug(radius.inputs["Points"], points)
    tree.plug(radius.inputs["Radius"], splat.scale.dot((1 / 3, 1 / 3, 1 / 3)))
    return set_material(tree, radius.outputs[0], point_material())


def _corners(tree: Tree) -> Any:
    """The rectangle from (-1, -1) to (1, 1), its corners stored as attribute."""
    grid = tree.node("GeometryNodeMeshGrid")
    for name, value in (("Size X", 2.0), ("Size Y", 2.0), ("Vertices X", 2), ("Vertices Y", 2)):
        grid.inputs[name].default_value = value
    position = Vector(tree, tree.node("GeometryNodeInputPosition").outputs[0])
    return store(tree, grid.outputs[0], CORNER, position)


def _describe(group: bpy.types.NodeTree) -> None:
    """Defaults, ranges and tooltips of the inputs that people see."""
    settings: dict[str, dict[str, Any]] = {
        "Show As": {"default_value": SHOW[0], "description": "Quads are exact for the active camera; ellipsoids are "
                    "right from everywhere; Automatic renders quads and shows ellipsoids in the viewport"},
        "SH Degree": {"default_value": 3, "min_value": 0, "max_value": 3,
                      "description": "Highest band of view-dependent color, seen from the active camera"},
        "DoG": {"default_value": True, "description": "Subtract the pseudo-Gaussians"},
        "Linear Colors": {"default_value": True, "description": "Blend in linear light, for view transforms such as "
                          "Standard and AgX; off: blend sRGB values as trained, for the view transform Raw"},
        "Antialiased": {"default_value": False, "description": "For models trained with antialiasing"},
        "Near Clip": {"default_value": NEAR_CLIP, "min_value": 0.0, "subtype": "DISTANCE",
                      "description": "Splats nearer to the camera plane are left out"},
        "Viewport Share": {"default_value": 1.0, "min_value": 0.0, "max_value": 1.0, "subtype": "FACTOR",
                           "description": "Viewports show this share of the splats, the most important ones; renders "
                           "show all"},
        "Moving Share": {"default_value": 1.0, "description": "The same, written while a viewport moves"},
    }  # fmt: skip
    camera = {"default_value": 1000.0, "description": "Of the active camera, in pixels; kept up to date by a driver"}
    hidden = (*CAMERA_INPUTS, *VIEW_INPUTS)
    describe(group, settings | dict.fromkeys(CAMERA_INPUTS, camera), hidden)
