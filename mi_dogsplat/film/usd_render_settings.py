"""The render settings of an OpenUSD stage (UsdRenderSettings): which camera, and what picture it makes.

What a product of theirs (UsdRenderProduct) says by itself comes before them, of pictures of its camera.

Films have square pixels. Where the settings have others, the picture has the proportions in which theirs is shown.
"""

# pyright: reportAttributeAccessIssue=false
# (the library has no types)

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from .camera_path import DEFAULT_SIZE

if TYPE_CHECKING:
    from pxr import Gf, Sdf, Usd

LARGEST_SIDE = 16_384  # pixels
SQUARED = "adjustPixelAspectRatio"  # a policy by which pixels become as wide as the aperture asks for
EXPAND = "expandAperture"  # the policy of settings that say nothing
POLICIES = {  # by width over height of an aperture and of a picture: whether the aperture's height fills the picture's
    EXPAND: lambda aperture, picture: aperture < picture,
    "cropAperture": lambda aperture, picture: aperture > picture,
    "adjustApertureWidth": lambda aperture, picture: True,
    "adjustApertureHeight": lambda aperture, picture: False,
}


def settings_camera(stage: Usd.Stage) -> list[Sdf.Path]:
    """The camera of the render settings, if they name one, or their first product does."""
    settings = _settings(stage)
    first = _products(settings)[:1]
    return next((camera for prim in (*first, settings) if (camera := _camera_of(prim))), [])


def picture_size(stage: Usd.Stage, camera: Sdf.Path, lens: Gf.Camera) -> tuple[int, int]:
    """Width and height of pictures of a camera: those of the render settings, else those of the aperture of its lens,
    the longer side as of any other film."""
    resolution = _said(stage, camera, "resolution")
    across, down = lens.horizontalAperture, lens.verticalAperture
    if resolution is not None and 0 < min(resolution) and max(resolution) <= LARGEST_SIDE:
        width, height = map(int, resolution)
        squared = _said(stage, camera, "aspectRatioConformPolicy") == SQUARED
        wide = across / down * height / width if squared else _pixel(stage, camera)
        return max(1, min(round(width * wide), LARGEST_SIDE)), height
    sides = np.array([across, down])
    width, height = np.maximum(1, np.round(sides / sides.max() * max(DEFAULT_SIZE))).astype(int)
    return int(width), int(height)


def shorter_side(stage: Usd.Stage, camera: Sdf.Path, lens: Gf.Camera, size: tuple[int, int]) -> float:
    """How much the shorter side of a picture of this size shows of the aperture of a camera's lens, in its unit.

    Where a picture has other proportions the settings' policy decides. All of the aperture is seen, and more at two
    sides, where they say nothing.
    """
    width, height = size
    across, down = lens.horizontalAperture, lens.verticalAperture
    by_height = POLICIES.get(str(_said(stage, camera, "aspectRatioConformPolicy")), POLICIES[EXPAND])
    return min(size) * (down / height if by_height(across / down, width / height) else across / width)


def _settings(stage: Usd.Stage) -> Usd.Prim:
    """The render settings that a stage names; an invalid prim, which is false, where it names none."""
    return stage.GetPrimAtPath(stage.GetMetadata("renderSettingsPrimPath") or "/_")


def _products(settings: Usd.Prim) -> list[Usd.Prim]:
    """Those of the settings that are there, in order."""
    if not (settings and settings.HasRelationship("products")):
        return []
    prims = (settings.GetStage().GetPrimAtPath(path) for path in settings.GetRelationship("products").GetTargets())
    return [prim for prim in prims if prim]


def _camera_of(prim: Usd.Prim) -> list[Sdf.Path]:
    """That of settings or of a product, if it names one."""
    return prim.GetRelationship("camera").GetTargets() if prim and prim.HasRelationship("camera") else []


def _said(stage: Usd.Stage, camera: Sdf.Path, name: str) -> Any:
    """What is said of pictures of a camera: by the first product of it, else by the settings, or the schema for them;
    None where there are none."""
    settings = _settings(stage)
    shown = _camera_of(settings)
    product = next((one for one in _products(settings) if (_camera_of(one) or shown or [camera]) == [camera]), None)
    if product and product.GetAttribute(name).HasAuthoredValue():
        return product.GetAttribute(name).Get()
    return settings.GetAttribute(name).Get() if settings else None


def _pixel(stage: Usd.Stage, camera: Sdf.Path) -> float:
    """The width of a pixel over its height; 1 where the settings say nothing, or what is none."""
    aspect = _said(stage, camera, "pixelAspectRatio")
    return aspect if isinstance(aspect, float) and 0 < aspect < math.inf else 1.0
