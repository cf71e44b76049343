"""What the colours of a model mean: sRGB values, or linear radiance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .model import Model
from .sh import C0
from .srgb import decoded, decoded_slope

# Of SPZ: the colour of code 255, the radiance that it stands for, and the comment that says that there is a curve
SPZ_MOST, SPZ_BRIGHTEST, SPZ_CURVE = 0.5 + C0 * 0.5 / 0.15, 1024.0, "dogsplat curve srgb_log"


@dataclass(frozen=True)
class Light:
    """``white``: the linear radiance that a screen shows as white; of display-referred models it means nothing."""

    linear: bool = False
    white: float = 1.0


def in_common_light(models: Sequence[Model], lights: Sequence[Light]) -> tuple[list[Model], Light]:
    """The models as they can be drawn together, and the light of all: linear where one is, of the first one's white."""
    common = next((light for light in lights if light.linear), Light())
    pairs = zip(models, lights, strict=True)
    return [model if light.linear == common.linear else made_linear(model) for model, light in pairs], common


def made_linear(model: Model) -> Model:
    """A model of sRGB values in linear radiance: exact for mean colours, to first order for the rest.

    A brightness of all channels becomes their mean, as it stays one.
    """
    color = 0.5 + C0 * model.sh_coeffs[:, 0].astype(np.float64)  # [N, 3]
    steepness = decoded_slope(color)
    sh = model.sh_coeffs * steepness[:, None]
    sh[:, 0] = (decoded(color) - 0.5) / C0
    return replace(
        model,
        sh_coeffs=sh.astype(np.float32),
        color_slopes=(model.color_slopes * steepness[:, None]).astype(np.float32),
        brightness_curvatures=(model.brightness_curvatures * steepness.mean(axis=1)[:, None]).astype(np.float32),
    )


def spz_radiance(model: Model, light: Light, comments: Sequence[str]) -> Model:
    """A linear model of an SPZ file, which is in units of white, and through a curve where a comment says so."""
    color = 0.5 + C0 * model.sh_coeffs[:, 0].astype(np.float64)
    if SPZ_CURVE in comments:
        power = np.log(SPZ_BRIGHTEST) / (SPZ_MOST - 1)
        color = np.where(color > 1, np.exp((np.maximum(color, 1) - 1) * power), decoded(np.minimum(color, 1)))
    sh = model.sh_coeffs * np.float32(light.white)
    sh[:, 0] = (color * light.white - 0.5) / C0
    return replace(model, sh_coeffs=sh.astype(np.float32))
