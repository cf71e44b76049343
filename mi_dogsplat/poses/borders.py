"""Black borders that photographs have where a program has taken the lens out of them: they are no part of the scene.

They are alike in all photographs of a lens, so what is black in all of them, up to the edges, is such a border, and a
dark room in one of them is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

from ..datasets.images import stored
from ..support.files import replacing
from .photographs import readable

BLACK = 16  # of 255: JPEG leaves ripples where it is black
RIPPLES = 8  # pixels of a block of JPEG: how far from the border they reach


def black_border(images: Sequence[Path]) -> np.ndarray | None:
    """Which pixels [H, W] are border in all images, and a block of JPEG around these; None where there are none, and
    for images of several sizes. Raises ``DataError``."""
    brightest: np.ndarray | None = None
    for file in images:
        with readable(file) as image:
            levels = np.asarray(stored(image).convert("RGB")).max(axis=2)
        if brightest is not None and levels.shape != brightest.shape:
            return None
        brightest = levels if brightest is None else np.maximum(brightest, levels)
    if brightest is None:
        return None
    black = np.pad(brightest < BLACK, 1, constant_values=True)  # what touches an edge is one region
    edge = np.zeros_like(black)
    edge[0, 0] = True
    border = ndimage.binary_propagation(edge, mask=black)[1:-1, 1:-1]
    return ndimage.binary_dilation(border, np.ones((3, 3)), RIPPLES) if border.any() else None


def write_border_masks(border: np.ndarray, names: Sequence[str], folder: Path) -> int:
    """Write the mask of each image, black in the border [H, W], by its name; returns how many."""
    mask = Image.fromarray(np.where(border, 0, 255).astype(np.uint8))
    for name in names:
        with replacing(folder / f"{name}.png") as part:
            mask.save(part, "PNG")
    return len(names)
