"""Blender's Principled BSDF as Mitsuba's, which is Disney's; what transmits everything is a dielectric."""

from __future__ import annotations

import math

import bpy
import numpy as np

from .bsdf import LEAST_IOR, glass, two_sided
from .export import Plugin, rgb
from .sockets import Reader, constant_of

TRANSPARENT = 0.999  # transmission from which on the rest is not worth a lobe
LEFT_OUT = ("Subsurface Weight", "Thin Film Thickness", "Anisotropic", "Diffuse Roughness")
TINTS = {"Specular Tint": "Specular IOR Level", "Coat Tint": "Coat Weight", "Sheen Tint": "Sheen Weight"}  # of what


def principled(reader: Reader, node: bpy.types.Node) -> tuple[Plugin, Plugin | None, float | Plugin | None]:
    """(BSDF, radiance that it emits, opacity); the latter two are None where they do nothing."""
    inputs = node.inputs
    for name in LEFT_OUT:
        if name in inputs and (inputs[name].is_linked or inputs[name].default_value > 0):
            reader.note('"{name}" is left out', name=name)
    for name, weight in TINTS.items():
        if constant_of(inputs[weight]) != 0 and not np.array_equal(constant_of(inputs[name]), (1, 1, 1)):
            reader.note('"{name}" is left out', name=name)
    transmission = reader.share(inputs["Transmission Weight"])
    metallic, roughness = reader.share(inputs["Metallic"]), reader.share(inputs["Roughness"])
    ior = reader.constant(inputs["IOR"], LEAST_IOR)
    if isinstance(transmission, float) and transmission > TRANSPARENT and metallic == 0:
        rough = roughness if isinstance(roughness, float) else reader.constant(inputs["Roughness"], 0.0, 1.0)
        bsdf = glass(rough, ior, {"specular_transmittance": _root(reader, inputs["Base Color"])})
        note_normal(reader, node)
    else:
        values = {"metallic": metallic, "roughness": roughness, **_coatings(reader, node)}
        if transmission == 0:
            eta = eta_of(ior, reader.constant(inputs["Specular IOR Level"], 0.0))
            values["base_color"] = reader.reflectance(inputs["Base Color"], left_to_diffuse(metallic, eta))
            bsdf = two_sided(bent(reader, node, {"type": "principled", "eta": eta, **values}))
        else:
            base = reader.reflectance(inputs["Base Color"])
            values |= {"eta": max(ior, 1.001), "spec_trans": transmission, "base_color": base}
            bsdf = bent(reader, node, {"type": "principled", **values})
    alpha = reader.share(inputs["Alpha"])
    return bsdf, _radiance(reader, node), None if alpha == 1 else alpha


def eta_of(ior: float, level: float) -> float:
    """The index of refraction whose mirror image is 2 ``level`` times as strong as that of ``ior``."""
    reflectance = min(2 * level * ((ior - 1) / (ior + 1)) ** 2, 0.9)
    return max((1 + math.sqrt(reflectance)) / (1 - math.sqrt(reflectance)), 1.001)


def left_to_diffuse(metallic: float | Plugin, eta: float) -> float:
    """The share of light from straight ahead that the specular layer does not reflect: a factor of the base color.

    Blender's diffuse part has what that layer leaves, Disney's has all light. Metals have no such part; a texture is
    taken for one of metal.
    """
    return 1 - (1 - metallic) * ((eta - 1) / (eta + 1)) ** 2 if isinstance(metallic, float) else 1.0


def _coatings(reader: Reader, node: bpy.types.Node) -> Plugin:
    """Sheen and coat, where there are any; Disney's coat is a quarter as strong as Blender's of weight one."""
    found: Plugin = {}
    if sheen := reader.constant(node.inputs["Sheen Weight"], 0.0, 1.0):
        found |= {"sheen": sheen}
    if coat := reader.constant(node.inputs["Coat Weight"], 0.0, 1.0):
        roughness = reader.constant(node.inputs["Coat Roughness"], 0.0, 1.0)
        if reader.source(node.inputs["Coat Normal"]) != reader.source(node.inputs["Normal"]):
            reader.note("its coat has the normals of what is below it")
        found |= {"clearcoat": coat, "clearcoat_gloss": 1 - roughness}
    return found


def _root(reader: Reader, socket: bpy.types.NodeSocket) -> Plugin:
    """Light passes two interfaces, and the colour is that of both."""
    base = reader.reflectance(socket)
    if base["type"] != "rgb":
        reader.note("the texture colors what is seen through it at each of its two surfaces")
        return base
    return rgb(np.sqrt(np.maximum(base["value"], 0)))


def note_normal(reader: Reader, node: bpy.types.Node) -> None:
    """Say that the normals of a shader are not bent, where they would be."""
    if "Normal" in node.inputs and (source := reader.source(node.inputs["Normal"])) is not None:
        reader.note('the node "{node}" does not bend normals in Mitsuba', node=source.node.name)


def bent(reader: Reader, node: bpy.types.Node, bsdf: Plugin) -> Plugin:
    """With the normal map of the node."""
    source = reader.source(node.inputs["Normal"])
    if source is None:
        return bsdf
    normal = source.node
    if normal.type != "NORMAL_MAP" or normal.space != "TANGENT":
        note_normal(reader, node)
        return bsdf
    if normal.inputs["Strength"].is_linked or normal.inputs["Strength"].default_value != 1:
        reader.note("its normal map has the strength 1")
    image = reader.source(normal.inputs["Color"])
    texture = reader.texture(image) if image is not None else None
    return {"type": "normalmap", "normalmap": texture | {"raw": True}, "bsdf": bsdf} if texture else bsdf


def _radiance(reader: Reader, node: bpy.types.Node) -> Plugin | None:
    strength = reader.constant(node.inputs["Emission Strength"])
    if strength == 0:
        return None
    color = reader.color(node.inputs["Emission Color"], strength)
    return None if color["type"] == "rgb" and not any(color["value"]) else color
