"""The sRGB curve (IEC 61966-2-1), both ways; node trees are built of its numbers too."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LINEAR_KNEE, KNEE = 0.0031308, 0.04045  # below: a line of this slope, linear and encoded
SLOPE, OFFSET, SCALE, POWER = 12.92, 0.055, 1.055, 2.4


def encoded(linear: NDArray) -> NDArray:
    """Linear values as sRGB ones, of any shape; also above 1."""
    curve = SCALE * np.maximum(linear, LINEAR_KNEE) ** (1 / POWER) - OFFSET
    return np.where(linear <= LINEAR_KNEE, SLOPE * linear, curve)


def decoded(srgb: NDArray) -> NDArray:
    """sRGB values as linear ones, of any shape; also above 1."""
    return np.where(srgb <= KNEE, srgb / SLOPE, ((np.maximum(srgb, KNEE) + OFFSET) / SCALE) ** POWER)


def decoded_slope(srgb: NDArray) -> NDArray:
    """The derivative of ``decoded``."""
    curve = POWER / SCALE * ((np.maximum(srgb, KNEE) + OFFSET) / SCALE) ** (POWER - 1)
    return np.where(srgb <= KNEE, 1 / SLOPE, curve)
