"""Materials as BSDFs and emitters of Mitsuba: Principled BSDF and the plain shaders, mixed and added.

What has no counterpart is drawn in the colour of the viewport, and a line says so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np

from .bsdf import BLACK, LEAST_IOR, SMOOTH, glass, two_sided
from .export import Export, Plugin, reflected_rgb, rgb
from .principled import bent, left_to_diffuse, note_normal, principled
from .products import product
from .sockets import Reader, active_tree, output_of

GREY = 1e-4  # by how much the channels of a grey differ
DEFAULT, PLASTIC = (0.8, 0.8, 0.8), 1.5  # of what has no material: its color, and its index of refraction


@dataclass
class Surface:
    """A BSDF of both sides, what it emits, and how much of it covers (None: all)."""

    bsdf: Plugin
    radiance: Plugin | None = None
    opacity: float | Plugin | None = None

    @property
    def is_nothing(self) -> bool:
        """Whether it neither covers nor shines, so that nobody sees it and no light ends at it."""
        return self.opacity == 0 and self.radiance is None

    def whole(self) -> Plugin:
        """The BSDF with its opacity."""
        return self.bsdf if self.opacity is None else {"type": "mask", "opacity": self.opacity, "bsdf": self.bsdf}


def surface(export: Export, material: bpy.types.Material | None, uv_maps: frozenset[str]) -> Surface:
    """What a material looks like, on meshes with these UV maps."""
    if material is None and bpy.app.version >= (5, 0):
        return _plastic(DEFAULT, 0.5, 0.0)
    tree = material and active_tree(material)
    if material is None or tree is None:
        color = DEFAULT if material is None else material.diffuse_color
        return Surface(two_sided({"type": "diffuse", "reflectance": reflected_rgb(color)}))
    reader = Reader(export, material.name, uv_maps)
    output = output_of(tree)
    if output is None:
        return Surface(BLACK, None, 0.0)
    if reader.source(output.inputs["Displacement"]) is not None:
        reader.note("its displacement is left out")
    if reader.source(output.inputs["Volume"]) is not None:
        reader.note("its volume is left out")
        if reader.source(output.inputs["Surface"]) is None:  # fog without a skin, which nobody sees from outside
            return Surface(BLACK, None, 0.0)
    return _shader(reader, material, output.inputs["Surface"])


def _shader(reader: Reader, material: bpy.types.Material, socket: bpy.types.NodeSocket) -> Surface:
    source = reader.source(socket)
    if source is None:
        return Surface(BLACK)
    node = source.node
    if node.type in ("MIX_SHADER", "ADD_SHADER"):
        first, second = (_shader(reader, material, socket) for socket in node.inputs[-2:])
        return _mixed(reader, node, first, second) if node.type == "MIX_SHADER" else _added(reader, first, second)
    if node.type not in SHADERS:
        reader.note(
            'the shader "{node}" has no counterpart in Mitsuba; drawn in the color of the viewport', node=node.name
        )
        return _viewport(material)
    return SHADERS[node.type](reader, node)


def _viewport(material: bpy.types.Material) -> Surface:
    return _plastic(material.diffuse_color, material.roughness, material.metallic)


def _plastic(color: Sequence[float], roughness: float, metallic: float) -> Surface:
    """A Principled BSDF that has else what a new one has."""
    base = reflected_rgb(np.multiply(color[:3], left_to_diffuse(metallic, PLASTIC)))
    values = {"base_color": base, "roughness": roughness, "metallic": metallic, "eta": PLASTIC}
    return Surface(two_sided({"type": "principled", **values}))


def _principled(reader: Reader, node: bpy.types.Node) -> Surface:
    bsdf, radiance, opacity = principled(reader, node)
    return Surface(bsdf, _weakened(reader, radiance, 1.0 if opacity is None else opacity), opacity)


def _diffuse(reader: Reader, node: bpy.types.Node) -> Surface:
    diffuse = {"type": "diffuse", "reflectance": reader.reflectance(node.inputs["Color"])}
    return Surface(two_sided(bent(reader, node, diffuse)))


def _glossy(reader: Reader, node: bpy.types.Node) -> Surface:
    roughness = reader.constant(node.inputs["Roughness"], 0.0, 1.0)
    color = {"material": "none", "specular_reflectance": reader.reflectance(node.inputs["Color"])}
    if roughness < SMOOTH:
        return Surface(two_sided(bent(reader, node, {"type": "conductor", **color})))
    rough = {"type": "roughconductor", "distribution": "ggx", "alpha": roughness**2, **color}
    return Surface(two_sided(bent(reader, node, rough)))


def _glass(reader: Reader, node: bpy.types.Node) -> Surface:
    note_normal(reader, node)
    color = reader.reflectance(node.inputs["Color"])
    tints = {"specular_transmittance": color}
    if node.type == "BSDF_GLASS":
        tints["specular_reflectance"] = color
    roughness = reader.constant(node.inputs["Roughness"], 0.0, 1.0)
    return Surface(glass(roughness, reader.constant(node.inputs["IOR"], LEAST_IOR), tints))


def _translucent(reader: Reader, node: bpy.types.Node) -> Surface:
    note_normal(reader, node)
    color = reader.reflectance(node.inputs["Color"])
    return Surface({"type": "principledthin", "base_color": color, "roughness": 1.0, "eta": 1.001, "diff_trans": 2.0})


def _transparent(reader: Reader, node: bpy.types.Node) -> Surface:
    """A grey is an opacity; glass that neither bends nor mirrors has any colour."""
    color = reader.reflectance(node.inputs["Color"])
    if color["type"] == "rgb" and np.ptp(color["value"]) < GREY:
        return Surface(BLACK, None, 1 - color["value"][0])
    return Surface({"type": "thindielectric", "int_ior": 1.0, "ext_ior": 1.0, "specular_transmittance": color})


def _emission(reader: Reader, node: bpy.types.Node) -> Surface:
    strength = reader.constant(node.inputs["Strength"])
    return Surface(BLACK, reader.color(node.inputs["Color"], strength))


def _mixed(reader: Reader, node: bpy.types.Node, first: Surface, second: Surface) -> Surface:
    """``Fac`` is the share of the second; what is transparent becomes the opacity of the other."""
    share = reader.share(node.inputs[0])
    if first.opacity == 0 and second.opacity is None:
        return replace(second, radiance=_weakened(reader, second.radiance, share), opacity=share)
    if isinstance(share, dict):
        if first.radiance or second.radiance:
            reader.note("light of a mixture by a texture is left out")
        return Surface({"type": "blendbsdf", "weight": share, "a": first.whole(), "b": second.whole()})
    if second.opacity == 0 and first.opacity is None:
        return replace(first, radiance=_weakened(reader, first.radiance, 1 - share), opacity=1 - share)
    if share in (0.0, 1.0):
        return second if share else first
    lights = [_weakened(reader, first.radiance, 1 - share), _weakened(reader, second.radiance, share)]
    blend = {"type": "blendbsdf", "weight": share, "a": first.whole(), "b": second.whole()}
    return Surface(blend, _sum(reader, [light for light in lights if light]))


def _added(reader: Reader, first: Surface, second: Surface) -> Surface:
    """Mitsuba adds no BSDFs: of two that are not black the first is kept, and what it covers is not seen."""
    radiance = _sum(reader, [light for light in (first.radiance, second.radiance) if light])
    if first.bsdf is BLACK and second.bsdf is BLACK:  # light, and what is seen through it
        return Surface(BLACK, radiance, _in_common(reader, first.opacity, second.opacity))
    kept, other = (second, first) if first.bsdf is BLACK else (first, second)
    if other.bsdf is not BLACK:
        reader.note("of two shaders that are added the first is kept")
    elif other.opacity is not None:
        reader.note("a transparent shader that is added to another is left out")
    return replace(kept, radiance=radiance)


def _in_common(reader: Reader, first: float | Plugin | None, second: float | Plugin | None) -> float | Plugin | None:
    """The opacity of two that are black: what is seen through one is added to what is seen through the other."""
    if first is None or second is None:
        return second if first is None else first
    if isinstance(first, float) and isinstance(second, float):
        return max(first + second - 1, 0.0)
    reader.note("of two shaders that are added the first is kept")
    return first


def _weakened(reader: Reader, light: Plugin | None, share: float | Plugin) -> Plugin | None:
    """What shines of a surface of which this share is there: Mitsuba's masks and blends leave light as it is."""
    if light is None or share == 1:
        return light
    found = product(reader.export, light, share)
    if found is None:
        reader.note("light of a mixture by a texture is left out")
    return found


def _sum(reader: Reader, lights: list[Any]) -> Plugin | None:
    if len(lights) < 2:
        return lights[0] if lights else None
    if any(light["type"] != "rgb" for light in lights):
        reader.note("of two lights the first is kept")
        return lights[0]
    return rgb([sum(parts) for parts in zip(*(light["value"] for light in lights), strict=True)])


SHADERS: dict[str, Callable[[Reader, Any], Surface]] = {
    "BSDF_PRINCIPLED": _principled,
    "BSDF_DIFFUSE": _diffuse,
    "BSDF_GLOSSY": _glossy,
    "BSDF_ANISOTROPIC": _glossy,
    "BSDF_GLASS": _glass,
    "BSDF_REFRACTION": _glass,
    "BSDF_TRANSLUCENT": _translucent,
    "BSDF_TRANSPARENT": _transparent,
    "EMISSION": _emission,
}
