"""Which radiance a screen is to show as white: what makes pictures of linear radiance independent of its unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..support.srgb import luminance
from .dataset import Dataset, View

PERCENTILE, LEVEL = 95, 0.5  # of luminances, and of white: where it is in photographs of rooms and gardens
MAX_VIEWS = 16  # that are looked at
SOLID = 0.5  # alpha from which a pixel counts


def auto_exposed(dataset: Dataset) -> Dataset:
    """The data set with the ``reference_white`` of its training views; as it is where it is display-referred."""
    return dataset if dataset.white is None else dataset.exposed(reference_white(dataset.train))


def reference_white(views: Sequence[View]) -> float:
    """Radiance of which the 95th percentile of the luminances that the views show is a half.

    Only pixels with light and, where there is alpha, with more than half of it count; 1 where there are none. A
    percentile scales with the unit of radiance, and lamps of any brightness do not move it.
    """
    seen = views[:: -(-len(views) // MAX_VIEWS)]
    return white_of_lights(np.concatenate([_luminances(view.image) for view in seen]))


def white_of_lights(luminances: np.ndarray) -> float:
    """The same of luminances alone, [*]."""
    lights = luminances[luminances > 0]
    return float(np.percentile(lights, PERCENTILE)) / LEVEL if len(lights) else 1.0


def _luminances(image: np.ndarray) -> np.ndarray:
    """[*] of the pixels that count, of an image [H, W, 3] or premultiplied [H, W, 4]."""
    pixels = image.reshape(-1, image.shape[2])
    if pixels.shape[1] == 4:
        pixels = pixels[pixels[:, 3] > SOLID]
        pixels = pixels[:, :3] / pixels[:, 3:]
    return luminance(pixels)
