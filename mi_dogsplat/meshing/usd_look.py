"""The texture of a mesh in OpenUSD: its places, and a material that shows it without light."""

# pyright: reportAttributeAccessIssue=false
# (the library of OpenUSD has no types)

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..formats.usd_author import ROOT
from ..scene.splats import Array

if TYPE_CHECKING:
    from pxr import Usd, UsdShade

PLACES = "st"  # what programs call the places of a texture
DARK = {"diffuseColor": (0.0, 0.0, 0.0), "specularColor": (0.0, 0.0, 0.0)}


def paint(prim: Usd.Prim, uv: Array, picture: str) -> None:
    """Let a mesh show a picture, by its path from the stage, at ``uv`` [V, 2], down from the top. It shines by itself:
    the light of the photographs is in it."""
    from pxr import Sdf, UsdGeom, UsdShade, Vt

    up = np.ascontiguousarray(np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1), np.float32)
    kinds = Sdf.ValueTypeNames
    places = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(PLACES, kinds.TexCoord2fArray, UsdGeom.Tokens.vertex)
    places.Set(Vt.Vec2fArray.FromNumpy(up))
    stage = prim.GetStage()
    material = UsdShade.Material.Define(stage, f"{ROOT}/Look")
    reader = _shader(stage, "Places", "UsdPrimvarReader_float2", {"varname": (kinds.String, PLACES)})
    texture = _shader(stage, "Texture", "UsdUVTexture", {
        "file": (kinds.Asset, Sdf.AssetPath(picture)),
        "sourceColorSpace": (kinds.Token, "sRGB"),
        "wrapS": (kinds.Token, "clamp"),
        "wrapT": (kinds.Token, "clamp"),
    })  # fmt: skip
    dark = {name: (kinds.Color3f, value) for name, value in DARK.items()}
    surface = _shader(stage, "Surface", "UsdPreviewSurface", {"useSpecularWorkflow": (kinds.Int, 1), **dark})
    _connect(texture, "st", reader, "result", kinds.Float2)
    _connect(surface, "emissiveColor", texture, "rgb", kinds.Color3f)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", kinds.Token))
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def _shader(stage: Usd.Stage, name: str, kind: str, inputs: dict[str, tuple[Any, Any]]) -> UsdShade.Shader:
    """A node of the material: each input by its name, with its type and value."""
    from pxr import UsdShade

    shader = UsdShade.Shader.Define(stage, f"{ROOT}/Look/{name}")
    shader.CreateIdAttr(kind)
    for key, (of_type, value) in inputs.items():
        shader.CreateInput(key, of_type).Set(value)
    return shader


def _connect(to: UsdShade.Shader, name: str, source: UsdShade.Shader, output: str, kind: Any) -> None:
    to.CreateInput(name, kind).ConnectToSource(source.CreateOutput(output, kind))
