"""The sRGB curve, in both directions; models and pictures are display-referred, Mitsuba and OpenEXR are linear."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

POWER, OFFSET, SLOPE = 2.4, 0.055, 12.92  # IEC 61966-2-1
KNEE, LINEAR_KNEE = 0.04045, 0.0031308  # below: a line of this slope, encoded and linear
WHITE_SLOPE = (1 + OFFSET) / POWER  # of the encoded value at 1


def srgb_to_linear(values: ArrayLike) -> NDArray[np.float32]:
    """sRGB encoded values to linear ones (IEC 61966-2-1), not clamped; negative ones stay linear.

    What float32 cannot say is infinite, here and below.
    """
    v = np.asarray(values, np.float32)
    with np.errstate(over="ignore"):
        curve = ((np.maximum(v, 0) + OFFSET) / (1 + OFFSET)) ** POWER
    return np.where(v <= KNEE, v / SLOPE, curve).astype(np.float32)


def linear_to_srgb(values: ArrayLike) -> NDArray[np.float32]:
    """The inverse of `srgb_to_linear`."""
    v = np.asarray(values, np.float32)
    curve = (1 + OFFSET) * np.maximum(v, 0) ** (1 / POWER) - OFFSET
    with np.errstate(over="ignore"):
        return np.where(v <= LINEAR_KNEE, SLOPE * v, curve).astype(np.float32)


def displayed(radiance: ArrayLike, white: float = 1.0) -> NDArray[np.float32]:
    """What a screen shows of linear radiance: ``white`` as 1, by the sRGB curve, clamped to 0..1."""
    with np.errstate(over="ignore"):
        in_whites = np.asarray(radiance, np.float32) / np.float32(white)
    return np.clip(linear_to_srgb(in_whites), 0, 1)


def luminance(linear: NDArray) -> NDArray:
    """Of linear colours [..., 3] with the primaries of sRGB (Rec. 709)."""
    return linear @ np.array([0.2126, 0.7152, 0.0722], linear.dtype)


def linear_to_srgb_log(values: ArrayLike) -> NDArray[np.float64]:
    """The sRGB curve up to 1, from there on the logarithm that continues it: 1 + 0.44 ln x; negative ones stay linear.

    The tone curve of training (``images/tone_curve.py`` there): an error counts as the eye sees it, at any brightness.
    """
    v = np.asarray(values, np.float64)
    power = (1 + OFFSET) * np.clip(v, LINEAR_KNEE, 1) ** (1 / POWER) - OFFSET
    return np.where(v > 1, 1 + WHITE_SLOPE * np.log(np.maximum(v, 1)), np.where(v > LINEAR_KNEE, power, SLOPE * v))


def srgb_log_to_linear(values: ArrayLike) -> NDArray[np.float64]:
    """The inverse of `linear_to_srgb_log`."""
    v = np.asarray(values, np.float64)
    power = ((np.clip(v, 0, 1) + OFFSET) / (1 + OFFSET)) ** POWER
    below = np.where(v > SLOPE * LINEAR_KNEE, power, v / SLOPE)
    return np.where(v > 1, np.exp((np.maximum(v, 1) - 1) / WHITE_SLOPE), below)
