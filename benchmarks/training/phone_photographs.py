"""Photographs as a phone takes them: exposure and white balance of each image, vignetting, a response, all known.

The light of a photograph is found by the sRGB curve; what changes it is known, and 8 bits are left as in a file.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from mi_dogsplat.datasets import Dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.scene.appearance import radii_squared
from mi_dogsplat.support.srgb import linear_to_srgb, srgb_to_linear

# A phone's sensor sees colours mixed: white balance acts there, and comes out of sRGB's channels mixed again.
SRGB_FROM_SENSOR = np.array([[1.7, -0.55, -0.15], [-0.2, 1.45, -0.25], [0.0, -0.5, 1.5]])
GREY = 0.18


@dataclass(frozen=True)
class Phone:
    """What the phone does.

    Args:
        exposure: spread of the exposure, EV, uniform.
        automatic: share of the exposure that follows the brightness of the picture, 0..1.
        warmth: spread of the white balance, log2 of red over blue on the sensor, uniform.
        vignetting: share of the light that the corners lose.
        contrast: of a filmic response after the sRGB curve; 0: none.
    """

    exposure: float = 0.0
    automatic: float = 0.0
    warmth: float = 0.0
    vignetting: float = 0.0
    contrast: float = 0.0

    def photograph(self, view: View, rng: np.random.Generator) -> View:
        """The view as the phone would have taken it."""
        light = srgb_to_linear(view.image).astype(np.float64)
        brightness = np.log2(GREY / max(1e-3, float(light.mean())))
        ev = self.exposure * rng.uniform(-1, 0.25) + self.automatic * brightness
        tint = self.warmth * rng.uniform(-0.5, 0.5)
        balance = SRGB_FROM_SENSOR @ np.diag([2**tint, 1, 2**-tint]) @ np.linalg.inv(SRGB_FROM_SENSOR)
        r_sq = radii_squared(view.camera)[..., None]
        fall_off = (1 - self.vignetting * r_sq) if self.vignetting else 1.0
        display = linear_to_srgb(np.maximum(2**ev * fall_off * (light @ balance.T), 0)).astype(np.float64)
        if self.contrast:  # towards a smooth step, with its toe and shoulder
            x = np.clip(display, 0, 1)
            display = (1 - self.contrast) * x + self.contrast * x * x * (3 - 2 * x)
        pixels = np.rint(np.clip(display, 0, 1) * 255).astype(np.float32) / 255
        return View(view.name, view.camera, pixels, view.straight)


PHONES = {
    "steady": Phone(),
    "varied": Phone(exposure=1.5, warmth=0.6, vignetting=0.35),
    "automatic": Phone(automatic=1.0, exposure=1.2, warmth=0.3, vignetting=0.3, contrast=0.6),
}


def taken(dataset: Dataset, phone: Phone, seed: int = 0) -> Dataset:
    """The data set as the phone would have taken it, test views too; opaque images."""
    rng = np.random.default_rng(seed)
    if phone == Phone():
        return dataset
    train, test = ([phone.photograph(view, rng) for view in views] for views in (dataset.train, dataset.test))
    return replace(dataset, train=train, test=test)
