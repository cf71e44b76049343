"""The sRGB curve, in both directions; models and pictures are display-referred, Mitsuba and OpenEXR are linear."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

POWER, OFFSET, SLOPE = 2.4, 0.055, 12.92  # IEC 61966-2-1
KNEE, LINEAR_KNEE = 0.04045, 0.0031308  # below: a line of this slope, encoded and linear


def srgb_to_linear(values: ArrayLike) -> NDArray[np.float32]:
    """sRGB encoded values to linear ones (IEC 61966-2-1), not clamped; negative ones stay linear."""
    v = np.asarray(values, np.float32)
    curve = ((np.maximum(v, 0) + OFFSET) / (1 + OFFSET)) ** POWER
    return np.where(v <= KNEE, v / SLOPE, curve).astype(np.float32)


def linear_to_srgb(values: ArrayLike) -> NDArray[np.float32]:
    """The inverse of `srgb_to_linear`."""
    v = np.asarray(values, np.float32)
    curve = (1 + OFFSET) * np.maximum(v, 0) ** (1 / POWER) - OFFSET
    return np.where(v <= LINEAR_KNEE, SLOPE * v, curve).astype(np.float32)


def displayed(radiance: ArrayLike, white: float = 1.0) -> NDArray[np.float32]:
    """What a screen shows of linear radiance: ``white`` as 1, by the sRGB curve, clamped to 0..1."""
    return np.clip(linear_to_srgb(np.asarray(radiance, np.float32) / np.float32(white)), 0, 1)


def luminance(linear: NDArray) -> NDArray:
    """Of linear colours [..., 3] with the primaries of sRGB (Rec. 709)."""
    return linear @ np.array([0.2126, 0.7152, 0.0722], linear.dtype)
