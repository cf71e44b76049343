"""Materials: what a splat adds to the picture at a point of its quad or ellipsoid.

With g the primary and g_p the pseudo-Gaussian, alpha = min(.99, a g) - min(.99, a_p g_p), ignored below 1/255; the
splat lets 1 - alpha of what is behind through and adds alpha times its colour. Cycles takes negative values of both
(checked by a test), so there DoG is exact. EEVEE clamps emission at zero, so there negative lobes are left out:
max(0, alpha).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from .builder import Tree, Value, Vector, arrange

VERSION = 12  # of the node trees; another version of the add-on makes its own
MIN_ALPHA = 1 / 255
MAX_ALPHA = 0.99
COLOR, KERNEL, PSEUDO = "splat:color", "splat:kernel", "splat:pseudo"  # of a quad: u, v, opacity of both kernels
EYE, SIDE = "splat:eye", "splat:side"  # of a quad for one of two eyes: it is seen from where p · eye >= side
OPACITIES, EXTENT, FACTOR = "splat:opacities", "splat:extent", "splat:factor"  # of an ellipsoid


def quad_material() -> bpy.types.Material:
    """For quads that face the camera: their corners carry u, v with g = exp(-(u² + v²) / 2) and the opacity."""
    return _material("DoG Splat quads", "GEOMETRY", _quad_alpha)


def eye_material() -> bpy.types.Material:
    """For quads of two eyes: the same, and nothing from the place of the other eye."""

    def alpha(tree: Tree) -> Value:
        place = tree.node("ShaderNodeVectorTransform", vector_type="POINT", convert_from="CAMERA", convert_to="WORLD")
        tree.plug(place.inputs[0], (0.0, 0.0, 0.0))
        side = tree.node("ShaderNodeAttribute", attribute_name=SIDE, attribute_type="GEOMETRY")
        along = Vector(tree, place.outputs[0]).dot(_attribute(tree, EYE, "GEOMETRY"))
        return _quad_alpha(tree) * (along > Value(tree, side.outputs["Fac"]))

    return _material("DoG Splat eyes", "GEOMETRY", alpha)


def _quad_alpha(tree: Tree) -> Value:
    parts = []
    for name in (KERNEL, PSEUDO):
        u, v, opacity = _attribute(tree, name, "GEOMETRY").split()
        parts.append(_bounded(tree, u * u + v * v, opacity))
    return parts[0] - parts[1]


def ellipsoid_material() -> bpy.types.Material:
    """For instances of the unit sphere scaled to the end of the kernel: g at the nearest point of the ray."""

    def alpha(tree: Tree) -> Value:
        surface = Vector(tree, tree.node("ShaderNodeTexCoord").outputs["Object"])
        to_object = tree.node("ShaderNodeVectorTransform", vector_type="VECTOR", convert_from="WORLD",
                              convert_to="OBJECT")  # fmt: skip
        geometry = tree.node("ShaderNodeNewGeometry")
        tree.plug(to_object.inputs[0], geometry.outputs["Incoming"])
        extent = _attribute(tree, EXTENT, "INSTANCER")
        factor = _attribute(tree, FACTOR, "INSTANCER")
        opacity, pseudo_opacity, _ = _attribute(tree, OPACITIES, "INSTANCER").split()
        point, direction = surface * extent, Vector(tree, to_object.outputs[0]) * extent  # in standard deviations
        parts = []
        for p, d, a in (
            (point, direction, opacity),
            (point / factor, direction / factor, pseudo_opacity),
        ):
            moment = p.cross(d)
            parts.append(_bounded(tree, moment.dot(moment) / d.dot(d), a))
        facing = 1.0 - Value(tree, geometry.outputs["Backfacing"])  # Cycles culls no faces
        return (parts[0] - parts[1]) * facing

    material = _material("DoG Splat ellipsoids", "INSTANCER", alpha)
    material.use_backface_culling = True
    return material


def point_material() -> bpy.types.Material:
    """For the preview as points: their colour, opaque."""

    def alpha(tree: Tree) -> Value:
        return tree.math("ADD", 1.0, 0.0)

    return _material("DoG Splat points", "GEOMETRY", alpha, opaque=True)


def draws_splats(material: bpy.types.Material | None) -> bool:
    """Whether it is one of these, of whichever version."""
    return material is not None and "dogsplat" in material


def _bounded(tree: Tree, distance2: Value, opacity: Value) -> Value:
    """min(.99, a exp(-r² / 2))."""
    return tree.math("MINIMUM", tree.math("EXPONENT", distance2 * -0.5) * opacity, MAX_ALPHA)


def _attribute(tree: Tree, name: str, kind: str) -> Vector:
    node = tree.node("ShaderNodeAttribute", attribute_name=name, attribute_type=kind)
    return Vector(tree, node.outputs["Vector"])


def cleared(material: bpy.types.Material) -> bpy.types.NodeTree:
    """The nodes of a new material, of which there are none any more."""
    if material.node_tree is None:  # Blender 4 and 5 ask for it; 6 has no other materials
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material.node_tree


def _material(name: str, kind: str, alpha: Callable[[Tree], Value], opaque: bool = False) -> bpy.types.Material:
    """The material of that name in this file, made where there is none of this version."""
    key = f"{name} {VERSION}"
    for existing in bpy.data.materials:
        if existing.get("dogsplat") == key and not existing.library:
            return existing
    material = bpy.data.materials.new(name)
    material["dogsplat"] = key
    tree = Tree(cleared(material))
    color = _attribute(tree, COLOR, kind)
    if opaque:
        emission = tree.node("ShaderNodeEmission")
        tree.plug(emission.inputs["Color"], color)
        tree.plug(tree.node("ShaderNodeOutputMaterial").inputs["Surface"], emission.outputs[0])
    else:
        signed = alpha(tree)
        seen = tree.math("ABSOLUTE", signed) > MIN_ALPHA
        signed = signed * seen
        _output(tree, "CYCLES", signed, color)
        _output(tree, "EEVEE", tree.math("MAXIMUM", signed, 0.0), color)
        material.surface_render_method = "BLENDED"
        material.use_transparency_overlap = True
        material.use_transparent_shadow = True
    if hasattr(material, "cycles"):
        material.cycles.emission_sampling = "NONE"  # a hundred thousand lamps help nobody
    arrange(material.node_tree)
    return material


def _output(tree: Tree, engine: str, alpha: Value, color: Vector) -> None:
    """A material output for one engine: (1 - alpha) of what is behind plus alpha times the colour."""
    through, glow = tree.node("ShaderNodeBsdfTransparent"), tree.node("ShaderNodeEmission")
    rest: Any = 1.0 - alpha
    tree.plug(through.inputs["Color"], tree.combine(rest, rest, rest))
    tree.plug(glow.inputs["Color"], color * alpha)
    both = tree.node("ShaderNodeAddShader")
    tree.plug(both.inputs[0], through.outputs[0])
    tree.plug(both.inputs[1], glow.outputs[0])
    output = tree.node("ShaderNodeOutputMaterial", target=engine)
    tree.plug(output.inputs["Surface"], both.outputs[0])
