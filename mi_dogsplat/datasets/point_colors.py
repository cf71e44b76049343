"""Colours of COLMAP's points: the numbers of the photographs, which need not be sRGB."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from .color_profiles import as_srgb
from .images import color_space


def in_srgb(colors: np.ndarray, photographs: Sequence[Path]) -> np.ndarray:
    """float32 [P, 3] in 0..1 as sRGB, where all ``photographs`` have one other space, else as they are.

    Raises ``DataError`` for a photograph that cannot be read.
    """
    space = color_space(photographs[0]) if len(colors) else None
    if space is None:
        return colors
    levels = np.rint(255 * colors).astype(np.uint8)
    converted = np.asarray(as_srgb(Image.fromarray(levels[None]), space))[0]
    if (converted == levels).all() or any(color_space(path) != space for path in photographs[1:]):
        return colors
    return converted.astype(np.float32) / 255
