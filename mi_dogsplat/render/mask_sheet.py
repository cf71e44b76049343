"""Photographs and what is masked in them, on one sheet to look at."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .panels import labelled

COLUMNS, ROWS = 4, 4
CELL = 240  # pixels of the longer side of a photograph
TINT, STRENGTH = np.array([0.9, 0.1, 0.2]), 0.5  # of what is masked


def mask_sheet(photographs: Iterable[tuple[NDArray, NDArray[np.bool_], str]]) -> NDArray[np.float32]:
    """[H, W, 3] sRGB values: the first few of photographs [H, W, 3] with their masks [h, w] and names, masked red."""
    cells = [_cell(*photograph) for photograph in islice(photographs, COLUMNS * ROWS)]
    height, width = (max(cell.shape[axis] for cell in cells) for axis in (0, 1))
    rows = -(-len(cells) // COLUMNS)
    page = np.ones((rows * height, min(COLUMNS, len(cells)) * width, 3), np.float32)
    for k, cell in enumerate(cells):
        top, left = k // COLUMNS * height, k % COLUMNS * width
        page[top : top + cell.shape[0], left : left + cell.shape[1]] = cell
    return page


def _cell(photograph: NDArray, masked: NDArray[np.bool_], name: str) -> NDArray:
    share = CELL / max(photograph.shape[:2])
    size = max(1, round(photograph.shape[1] * share)), max(1, round(photograph.shape[0] * share))
    shown = _resized(photograph, size)
    red = _resized(masked.astype(np.float32)[..., None].repeat(3, axis=2), size) * STRENGTH
    return labelled(shown * (1 - red) + TINT * red, f"{name}: {100 * masked.mean():.0f} %")


def _resized(image: NDArray, size: tuple[int, int]) -> NDArray:
    """[H, W, 3] of 0..1 as ``size``, width and height."""
    picture = Image.fromarray(np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8))
    return np.asarray(picture.resize(size, Image.Resampling.BOX), np.float32) / 255
