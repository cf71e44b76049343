"""What the colours of a model mean: sRGB values, or linear radiance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .model import Model
from .sh import C0

TOE = 0.0031308  # of the sRGB curve: below it is a line


@dataclass(frozen=True)
class Light:
    """``white``: the linear radiance that a screen shows as white; of display-referred models it means nothing."""

    linear: bool = False
    white: float = 1.0

    @property
    def comments(self) -> list[str]:
        """Lines of a PLY header that say it; none where it goes without saying."""
        return ["dogsplat linear true", f"dogsplat white {self.white!r}"] if self.linear else []


def in_common_light(models: Sequence[Model], lights: Sequence[Light]) -> tuple[list[Model], Light]:
    """The models as they can be drawn together, and the light of all: linear where one is, of the first one's white."""
    common = next((light for light in lights if light.linear), Light())
    pairs = zip(models, lights, strict=True)
    return [model if light.linear == common.linear else made_linear(model) for model, light in pairs], common


def made_linear(model: Model) -> Model:
    """A model of sRGB values in linear radiance: exact for mean colours, to first order for what directions add."""
    color = 0.5 + C0 * model.sh_coeffs[:, 0].astype(np.float64)  # [N, 3]
    power = ((np.maximum(color, 0) + 0.055) / 1.055) ** 1.4
    below = color <= 12.92 * TOE
    slope = np.where(below, 1 / 12.92, 2.4 / 1.055 * power)
    linear = np.where(below, color / 12.92, power * (np.maximum(color, 0) + 0.055) / 1.055)
    sh = model.sh_coeffs * slope[:, None]
    sh[:, 0] = (linear - 0.5) / C0
    return replace(model, sh_coeffs=sh.astype(np.float32))
