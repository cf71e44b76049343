"""The node group of Stereo 3D: quads for each of two eyes, of which a picture shows its own.

Blender evaluates nodes once for both eyes, and hides no object from one of them. But materials know from where they
are looked at. So the mesh has the quads of both, and their material lets through those of the other.
"""

from __future__ import annotations

import bpy

from .builder import new_group
from .color import color_group
from .fields import PARALLEL, POSE, Frame, Pose, frame_group, rotated, sees
from .geometry import set_material, store, switch
from .groups import GEOMETRY, cached_group, finish_group
from .material import COLOR, EYE, SIDE, eye_material
from .quads import quads_group

# Driven. Eyes: how far they are to the right of the camera, in halves of their distance. Convergence: 1 / its distance.
EYES = ("Left Eye", "Right Eye", "Eye Distance", "Toe-In", "Convergence")
APART = 1e-4  # of their distance, that quads of the two eyes are: Cycles passes over one of two at the same depth
LOOK = {"SH Degree": "NodeSocketInt", "Linear Colors": "NodeSocketBool", "DoG": "NodeSocketBool",
        "Near Clip": "NodeSocketFloat", "Antialiased": "NodeSocketBool"}  # fmt: skip


def both_eyes_group(space: str = "") -> bpy.types.NodeTree:
    """Quads and colours for the left eye, and for the right one, of points and the pose of their camera."""
    name = "DoG Splat both eyes"
    if existing := cached_group(name, space):
        return existing
    inputs = {"Points": "NodeSocketGeometry", **LOOK, **POSE, **dict.fromkeys(EYES, "NodeSocketFloat")}
    tree, (points, *values), exit_node = new_group(name, GEOMETRY, inputs, {"Quads": "NodeSocketGeometry"})
    look, pose, (left, right, *how) = values[:5], values[5:-5], values[-5:]
    eyes = [Pose(*tree.call(_eye_group(), *pose, eye, *how)) for eye in (left, right)]
    join = tree.node("GeometryNodeJoinGeometry")
    for own, other, farther in ((*eyes, 0.0), (*reversed(eyes), APART)):
        (quads,) = tree.call(_seen_group(space), points, *look, *own, other.location, farther)
        tree.plug(join.inputs[0], quads)
    tree.give(exit_node, [set_material(tree, join.outputs[0], eye_material())])
    return finish_group(tree, name, space)


def _eye_group() -> bpy.types.NodeTree:
    """The pose of an eye, as Blender has it: with *Toe-in* it turns, and around the other one if that is the pivot."""
    name = "DoG Splat eye"
    if existing := cached_group(name):
        return existing
    inputs = {**POSE, **dict.fromkeys(("Eye", *EYES[2:]), "NodeSocketFloat")}
    tree, (*of_camera, eye, distance, toe_in, convergence), exit_node = new_group(name, GEOMETRY, inputs, POSE)
    pose, half, size = Pose(*of_camera), distance * 0.5, tree.math("ABSOLUTE", eye)
    around = tree.math("MAXIMUM", size - 1.0, 0.0) * toe_in
    offset = eye * half
    right, forward = (rotated(tree, axis, pose.rotation) for axis in ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0)))
    aside = right * (offset * tree.math("COSINE", around)) + forward * (size * half * tree.math("SINE", around))
    turn = tree.node("FunctionNodeAxisAngleToRotation")
    tree.plug(turn.inputs["Axis"], (0.0, 1.0, 0.0))
    tree.plug(turn.inputs["Angle"], eye * toe_in)
    turned = tree.node("FunctionNodeRotateRotation", rotation_space="LOCAL")
    tree.plug(turned.inputs["Rotation"], pose.rotation)
    tree.plug(turned.inputs["Rotate By"], turn.outputs[0])
    center = pose.center + pose.focal * (1.0, 0.0, 0.0) * (offset * convergence)
    location = pose.location + aside * pose.mirror
    tree.give(exit_node, pose._replace(location=location, rotation=turned.outputs[0], center=center))
    return finish_group(tree, name)


def _seen_group(space: str) -> bpy.types.NodeTree:
    """The quads of points for the pose of an eye, told from those of the other one.

    They are farther than their splats by such a share, in the same pixels.
    """
    name = "DoG Splat seen"
    if existing := cached_group(name, space):
        return existing
    inputs = {"Points": "NodeSocketGeometry", **LOOK, **POSE, "Other": "NodeSocketVector", "Farther": "NodeSocketFloat"}
    tree, (points, *values), exit_node = new_group(name, GEOMETRY, inputs, {"Quads": "NodeSocketGeometry"})
    (degree, linear, *look), pose, (other, farther) = values[:5], Pose(*values[5:-2]), values[-2:]
    frame = Frame(*tree.call(frame_group(), *pose))
    (color,) = tree.call(color_group(space), frame.direction, degree, linear)
    (quads,) = tree.call(quads_group(), store(tree, points, COLOR, color), *look, *frame)
    axis = pose.location - other
    side = axis.dot(pose.location + other) * 0.5  # of what is halfway between them
    quads = store(tree, store(tree, quads, EYE, axis), SIDE, side, "FLOAT")
    away = tree.node("GeometryNodeSetPosition")
    depth = switch(tree, "FLOAT", sees(pose, PARALLEL), 1.0, frame.depth)  # a direction has no length there
    tree.plug(away.inputs["Geometry"], quads)
    tree.plug(away.inputs["Offset"], frame.direction * (depth * farther))
    tree.give(exit_node, [away.outputs[0]])
    return finish_group(tree, name, space)
