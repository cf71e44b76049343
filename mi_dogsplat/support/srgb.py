"""The sRGB curve, in both directions; models and pictures are display-referred, Mitsuba and OpenEXR are linear."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def srgb_to_linear(values: ArrayLike) -> NDArray[np.float32]:
    """sRGB encoded values to linear ones (IEC 61966-2-1), not clamped; negative ones stay linear."""
    v = np.asarray(values, np.float32)
    curve = ((np.maximum(v, 0) + 0.055) / 1.055) ** 2.4
    return np.where(v <= 0.04045, v / 12.92, curve).astype(np.float32)


def linear_to_srgb(values: ArrayLike) -> NDArray[np.float32]:
    """The inverse of `srgb_to_linear`."""
    v = np.asarray(values, np.float32)
    curve = 1.055 * np.maximum(v, 0) ** (1 / 2.4) - 0.055
    return np.where(v <= 0.0031308, 12.92 * v, curve).astype(np.float32)
