"""Colours whose red, green and blue are others than those of sRGB, as sRGB."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..support.srgb import displayed

Primaries = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
"""x and y of red, green and blue; their white is D65"""

SRGB: Primaries = (0.640, 0.330), (0.300, 0.600), (0.150, 0.060)
BT2020: Primaries = (0.708, 0.292), (0.170, 0.797), (0.131, 0.046)
P3: Primaries = (0.680, 0.320), (0.265, 0.690), (0.150, 0.060)
ADOBE_RGB: Primaries = (0.640, 0.330), (0.210, 0.710), (0.150, 0.060)
WIDE = {9: BT2020, 12: P3}  # that are wider than those of sRGB, as ISO/IEC 23091-2 numbers them
WHITE = 0.3127, 0.3290  # D65


def srgb_levels(light: NDArray[np.float32], primaries: Primaries) -> NDArray[np.uint8]:
    """sRGB of linear colours [H, W, 3] with these primaries, clipped to what that can hold."""
    matrix = np.linalg.solve(xyz_of(SRGB), xyz_of(primaries)).astype(np.float32)
    return np.rint(255 * displayed(light @ matrix.T)).astype(np.uint8)


@lru_cache
def xyz_of(primaries: Primaries) -> NDArray[np.float64]:
    """[3, 3], of linear colours with these primaries; the second row is luminance."""
    columns = np.array([(x / y, 1, (1 - x - y) / y) for x, y in (*primaries, WHITE)]).T
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3])
