"""The node group of the ellipsoids: instanced spheres whose material evaluates the kernel along the ray."""

from __future__ import annotations

import bpy

from .builder import new_group
from .fields import Splat
from .geometry import delete, set_material, store
from .groups import GEOMETRY, LOW_PASS, cached_group, cutoff, finish_group
from .material import EXTENT, FACTOR, OPACITIES, ellipsoid_material

SPHERE_RADIUS = 1 / 0.9339  # of an icosphere with 80 faces that holds the unit sphere
INPUTS = {
    "Points": "NodeSocketGeometry", "DoG": "NodeSocketBool", "Near Clip": "NodeSocketFloat",
    "Distance": "NodeSocketFloat", "Unit": "NodeSocketFloat", "Focal": "NodeSocketVector",
}  # fmt: skip


def ellipsoids_group() -> bpy.types.NodeTree:
    """A sphere per splat, scaled to where the wider of its kernels ends. The last three inputs are of a ``Frame``."""
    name = "DoG Splat ellipsoids"
    if existing := cached_group(name):
        return existing
    tree, (points, dog, near, distance, unit, focal), exit_node = new_group(
        name, GEOMETRY, INPUTS, {"Ellipsoids": "NodeSocketGeometry"}
    )
    splat = Splat(tree, dog)
    distance = tree.math("MAXIMUM", distance, near) / unit
    fx, fy, _ = focal.split()
    pixel2 = distance * distance / (fx * fy) * LOW_PASS  # low-pass variance at that distance
    primary, pseudo = (
        tree.combine(*(tree.math("SQRT", s * s + pixel2) for s in scale.split()))
        for scale in (splat.scale, splat.pseudo_scale)
    )
    reach, pseudo_reach = (tree.math("SQRT", cutoff(tree, a)) for a in (splat.opacity, splat.pseudo_opacity))
    size = (primary * reach).maximum(pseudo * pseudo_reach)
    points = delete(tree, points, 1.0 - (reach + pseudo_reach > 0.0))
    values = {EXTENT: size / primary, FACTOR: pseudo / primary,
              OPACITIES: tree.combine(splat.opacity, splat.pseudo_opacity)}  # fmt: skip
    for attribute, value in values.items():
        points = store(tree, points, attribute, value)
    sphere = tree.node("GeometryNodeMeshIcoSphere")
    sphere.inputs["Radius"].default_value = SPHERE_RADIUS
    sphere.inputs["Subdivisions"].default_value = 2
    place = tree.node("GeometryNodeInstanceOnPoints")
    tree.plug(place.inputs["Points"], points)
    tree.plug(place.inputs["Instance"], set_material(tree, sphere.outputs[0], ellipsoid_material()))
    tree.plug(place.inputs["Rotation"], splat.rotation)
    tree.plug(place.inputs["Scale"], size)
    tree.give(exit_node, [place.outputs[0]])
    return finish_group(tree, name)
