"""The Geometry Nodes tree of a model: from points with attributes to what the engines render.

Three ways to show a model, and "Automatic", which is quads in renders and ellipsoids in the viewport and in panoramas:

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
from .builder import Tree, new_group, wrap
from .color import color_group
from .ellipsoids import ellipsoids_group
from .fields import ALL_AROUND, PARALLEL, Frame, Pose, camera_pose, frame_group, mean_scale, sees
from .geometry import choose, delete, describe, set_material, store, switch
from .groups import GEOMETRY, cached_group, finish_group, named_attribute
from .material import COLOR, point_material
from .quads import quads_group
from .stereo import EYES, both_eyes_group

NAME = "DoG Splat"
SHOW = ("Automatic", "Quads", "Ellipsoids", "Points")
CAMERA_INPUTS = ("Focal X", "Focal Y", "Center X", "Center Y", "Width", "Height")  # driven, pixels
VIEW_INPUTS = ("Moving Share", "Moving Points", "View", "View Location", "View Rotation", "View Focal", "View Center",
               "View Size")  # fmt: skip
PROJECTION, VIEW_PROJECTION = "Projection", "View Projection"  # driven, and of the viewport: as ``Pose`` has it
VIEW_MIRROR = "View Mirror"  # of the viewport: as ``Pose`` has it
NOWHERE = -1e30  # the near clip of parallel rays, whose camera may stand anywhere along them
NEAR_CLIP = 0.2  # in units of the file, of models whose files say nothing
INPUTS = {
    "Geometry": "NodeSocketGeometry", "Show As": "NodeSocketMenu", "SH Degree": "NodeSocketInt",
    "DoG": "NodeSocketBool", "Linear Colors": "NodeSocketBool", "Antialiased": "NodeSocketBool",
    "Near Clip": "NodeSocketFloat", **dict.fromkeys(CAMERA_INPUTS, "NodeSocketFloat"),
    "Viewport Share": "NodeSocketFloat", "Moving Share": "NodeSocketFloat", "Moving Points": "NodeSocketBool",
    "View": "NodeSocketBool", "View Location": "NodeSocketVector", "View Rotation": "NodeSocketRotation",
    **dict.fromkeys(VIEW_INPUTS[5:], "NodeSocketVector"),
    PROJECTION: "NodeSocketFloat", VIEW_PROJECTION: "NodeSocketFloat",  # later ones last: others keep
    **dict.fromkeys((VIEW_MIRROR, *EYES), "NodeSocketFloat"),  # the identifiers that they had
}  # fmt: skip


def splat_tree(space: str = "") -> bpy.types.NodeTree:
    """The tree of this version for that working space in this file, made where there is none."""
    if existing := cached_group(NAME, space):
        return existing
    tree, inputs, exit_node = new_group(NAME, GEOMETRY, INPUTS, {"Geometry": "NodeSocketGeometry"})
    geometry, show, degree, dog, linear, antialiased, near, fx, fy, cx, cy, width, height, *of_view = inputs
    share, moving_share, moving_points, view, *view_numbers = of_view[:9]
    projection, view_projection, view_mirror, *eyes = of_view[9:]
    in_viewport = wrap(tree, tree.node("GeometryNodeIsViewport").outputs[0])
    pixels = tree.combine(fx, fy), tree.combine(cx, cy), tree.combine(width, height)
    place, rotation, *view_pixels = view_numbers
    of_camera = *camera_pose(tree), *pixels, projection
    of_viewport = place, rotation, view_mirror, *view_pixels, view_projection
    kinds = ("VECTOR", "ROTATION", "FLOAT", "VECTOR", "VECTOR", "VECTOR", "FLOAT")
    pose = Pose(*(switch(tree, kind, view * in_viewport, camera, own)
                  for kind, camera, own in zip(kinds, of_camera, of_viewport, strict=True)))  # fmt: skip
    frame = Frame(*tree.call(frame_group(), *pose))
    near = switch(tree, "FLOAT", sees(pose, PARALLEL), near, NOWHERE)

    to_points = tree.node("GeometryNodeMeshToPoints")
    tree.plug(to_points.inputs[0], geometry)
    shown = share * moving_share
    important = delete(tree, to_points.outputs[0], 1.0 - (named_attribute(tree, RANK, "FLOAT") < shown))
    some = switch(tree, "GEOMETRY", in_viewport * (shown < 1.0) > 0.5, to_points.outputs[0], important)
    (color,) = tree.call(color_group(space), frame.direction, degree, linear)
    points = store(tree, some, COLOR, color)
    (quads,) = tree.call(quads_group(), points, dog, near, antialiased, *frame)
    (both,) = tree.call(both_eyes_group(space), some, degree, linear, dog, near, antialiased, *pose, *eyes)
    stereo = ((eyes[1] - eyes[0]) * eyes[2] > 0.0) * (1.0 - in_viewport)
    quads = switch(tree, "GEOMETRY", stereo > 0.5, quads, both)
    (ellipsoids,) = tree.call(ellipsoids_group(), points, dog, near, frame.distance, frame.unit, frame.focal)
    from_everywhere = tree.math("MAXIMUM", in_viewport * (1.0 - view), sees(pose, ALL_AROUND))
    automatic = switch(tree, "GEOMETRY", from_everywhere > 0.5, quads, ellipsoids)
    as_points = _points(tree, points)
    ways = (automatic, quads, ellipsoids, as_points)
    chosen = choose(tree, "GEOMETRY", show, dict(zip(SHOW, ways, strict=True)))
    result = switch(tree, "GEOMETRY", in_viewport * moving_points > 0.5, chosen, as_points)
    tree.give(exit_node, [result])
    _describe(tree.tree)
    return finish_group(tree, NAME, space)


def _points(tree: Tree, points: Any) -> Any:
    """The point cloud, as large as the splats are on average over the axes."""
    radius = tree.node("GeometryNodeSetPointRadius")
    tree.plug(radius.inputs["Points"], points)
    tree.plug(radius.inputs["Radius"], mean_scale(tree))
    return set_material(tree, radius.outputs[0], point_material())


def _describe(group: bpy.types.NodeTree) -> None:
    """Defaults, ranges and tooltips of the inputs that people see."""
    settings: dict[str, dict[str, Any]] = {
        "Show As": {"default_value": SHOW[0], "description": "Quads are exact for the active camera; ellipsoids are "
                    "right from everywhere; Automatic renders quads, and shows ellipsoids in the viewport and in "
                    "panoramas"},
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
    hidden = (*CAMERA_INPUTS, *VIEW_INPUTS, PROJECTION, VIEW_PROJECTION, VIEW_MIRROR, *EYES)
    describe(group, settings | dict.fromkeys(CAMERA_INPUTS, camera), hidden)
