"""What float32 may do to an image, pixel by pixel: bounds to first order, as Higham has them for sums and products.

Notation of `forward.py` and `blending.py`. A kernel's value is right to a few units, of which alpha = G - G_p keeps the
absolute error: its relative one is larger by (G + G_p) / |alpha|. T is a product, so the relative errors of its factors
add, and an error of T is one of all that lies behind. An image is a sum of alpha T c: its error is in proportion to
the sum of their magnitudes, which negative alphas take to any size, and not to what their sum happens to be. A colour
that varies is itself a sum, of what it is at the centre and of what it has changed in x and in y.

Source: Higham, Accuracy and Stability of Numerical Algorithms (2002), chapters 3 and 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .blending import COLOR_UNITS, KERNEL_UNITS, UNIT, Blending, blocks
from .forward import MIN_T
from .projection import MIN_ALPHA, project

if TYPE_CHECKING:
    from ..scene.cameras import Camera
    from ..scene.splats import Splats


@dataclass
class Rounding:
    """Of an image over its background, float64."""

    magnitude: np.ndarray  # [H, W, 3] sum of |alpha| T |c|, and of T times the background
    error: np.ndarray  # [H, W, 3] by how much float32 may change the image


def rounding_tiled(splats: Splats, camera: Camera, background: Sequence[float] | np.ndarray = (0, 0, 0), *,
                   near_clip: float = 0.2) -> Rounding:
    """Magnitude and rounding of the image that `render_tiled` makes with the same near clip."""
    projection = project(splats, camera, near_clip=near_clip)
    light = np.abs(np.asarray(background, np.float64))
    magnitude = np.tile(light, (camera.height, camera.width, 1))
    error = UNIT * magnitude
    for block in blocks(projection, camera, MIN_ALPHA):
        blend = Blending(projection, block, True, MIN_ALPHA, MIN_T)
        of_T, size = blend.roundings(), np.abs(blend.alpha)
        in_front = np.concatenate([np.zeros_like(of_T[:1]), of_T[:-1]])
        of_weights = np.where(blend.blended, KERNEL_UNITS * UNIT * (blend.operands() + size) + in_front * size, 0)
        of_light, centres = blend.T_final[..., None] * light, blend.colors[blend.varying, None, None]
        to_sizes = np.abs(centres + blend.variations()) - centres  # what makes of the colours there their magnitudes
        magnitude[block.pixels] = blend.sum_of_colors(size * blend.T, to_sizes) + of_light
        of_blended = blend.sum_of_colors(of_weights * blend.T, to_sizes)
        error[block.pixels] = of_blended + (of_T[-1][..., None] + UNIT) * of_light
        if blend.varying.size:
            of_colors = COLOR_UNITS * UNIT * blend.terms()
            error[block.pixels] += np.einsum("nhw,nhwc->hwc", (size * blend.T)[blend.varying], of_colors)
    return Rounding(magnitude, error)
