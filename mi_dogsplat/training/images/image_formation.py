"""What a camera does to rendered colours, and its gradient, each as one kernel; in float64 and with the notation:
``reference/image_formation.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.arrays import array_types, detached, while_loop
from ...engine.frozen import frozen
from ...engine.parameters import device_array
from ...engine.srgb import decoded, decoded_slope, encoded, encoded_slope
from ...scene.appearance import GAINS, N_NUMBERS, VIGNETTING

LN2 = math.log(2)
N_SUMS = N_NUMBERS + 1
PIXELS = 8  # that a lane of the gradient adds up


@dataclass
class ImageSize:
    """What the kernels need to know about an image size."""

    size: int  # pixels; being no array it tells recordings apart, which hold the sizes of what they make
    width: Any  # opaque UInt
    half_width: Any  # opaque Float
    half_height: Any
    inv_corner_sq: Any  # 1 / squared distance of the corner from the middle
    n_pixels: Any  # opaque UInt
    inv_values: Any  # 1 / values of a picture
    lane: Any  # 0, 1, 2, ..., one for PIXELS pixels

    @staticmethod
    def of(width: int, height: int) -> ImageSize:
        n, corner_sq = width * height, (width / 2) ** 2 + (height / 2) ** 2
        lane = detached(device_array(np.arange(-(-n // PIXELS)), mi.UInt32))
        middle = [dr.opaque(array_types().Float, v / 2) for v in (width, height)]
        inv_corner_sq = dr.opaque(array_types().Float, 1 / corner_sq)
        inv_values = dr.opaque(array_types().Float, 1 / (3 * n))
        columns, pixels = (dr.opaque(array_types().UInt, v) for v in (width, n))
        return ImageSize(n, columns, middle[0], middle[1], inv_corner_sq, pixels, inv_values, lane)

    def radius_squared(self, pixel: Any) -> Any:
        """1 at the corner."""
        Float, y = array_types().Float, pixel // self.width
        dx = Float(pixel - y * self.width) + 0.5 - self.half_width
        dy = Float(y) + 0.5 - self.half_height
        return dr.fma(dx, dx, dy * dy) * self.inv_corner_sq


@frozen
def formed(planes: list, numbers: Any, image: ImageSize) -> list:
    """Planes [H W] of the photograph that a camera takes of three rendered ones; ``numbers`` [5] on the device."""
    pixel = dr.arange(array_types().UInt, image.size)
    factors = _Chain(numbers).factors(image.radius_squared(pixel))
    photograph = [encoded(factor * decoded(plane)) for factor, plane in zip(factors, planes, strict=True)]
    dr.eval(photograph)
    return photograph


@frozen
def formed_gradients(planes: list, numbers: Any, image: ImageSize, adjoint: list) -> tuple[list, Any]:
    """The gradients of Σ adjoint · formed by the planes, and sums as [6 lanes], one after the other.

    The sums, of whose lanes the sum is left to be taken, are the gradient by the five numbers, and that of Σ formed by
    one gain for all channels: how far the photograph could follow it.
    """
    Float, UInt = array_types().Float, array_types().UInt
    chain, lanes = _Chain(numbers), -(-image.size // PIXELS)
    n_lanes = (image.n_pixels + (PIXELS - 1)) // PIXELS
    by_planes = [dr.empty(Float, image.size) for _ in range(3)]

    def body(pixel: Any, sums: list) -> tuple:
        c, δ = ([dr.gather(Float, plane, pixel) for plane in of] for of in (planes, adjoint))
        by_c, terms = chain.gradients(c, image.radius_squared(pixel), δ)
        for plane, value in zip(by_planes, by_c, strict=True):
            dr.scatter(plane, value, pixel, mode=dr.ReduceMode.Permute)
        return pixel + n_lanes, [s + t for s, t in zip(sums, terms, strict=True)]

    zeros = [Float(0) for _ in range(N_SUMS)]
    state = (UInt(image.lane), zeros)
    _, sums = while_loop(state, lambda pixel, sums: pixel < image.n_pixels, body, "image formation")
    rows = dr.empty(Float, N_SUMS * lanes)
    for k, total in enumerate(sums):
        dr.scatter(rows, total, dr.fma(n_lanes, k, image.lane), mode=dr.ReduceMode.Permute)
    dr.eval(by_planes, rows)
    return by_planes, rows


class _Chain:
    """Trace-time helper: the numbers as variables, and what they do to the colours of a pixel."""

    def __init__(self, numbers: Any):
        p = [dr.gather(type(numbers), numbers, k) for k in range(N_NUMBERS)]
        self.gains, self.vignetting = p[GAINS], p[VIGNETTING]

    def factors(self, r_sq: Any) -> list:
        """L' / L of each channel."""
        a_1, a_2 = self.vignetting
        log_vignetting = r_sq * dr.fma(a_2, r_sq, a_1)
        return [dr.exp2(g + log_vignetting) for g in self.gains]

    def gradients(self, c: list, r_sq: Any, δ: list) -> tuple[list, list]:
        """By c, and by the five numbers, of Σ δ y; then that of Σ y by a common gain."""
        by_c, logs, reach = [], [], 0.0
        for value, factor, adjoint in zip(c, self.factors(r_sq), δ, strict=True):
            light = decoded(value)
            received = factor * light
            slope = encoded_slope(encoded(received), received)
            by_log = LN2 * slope * received
            logs.append(adjoint * by_log)
            reach += by_log
            by_c.append(adjoint * slope * factor * decoded_slope(value, light))
        by_vignetting = r_sq * (logs[0] + logs[1] + logs[2])
        return by_c, [*logs, by_vignetting, r_sq * by_vignetting, reach]
