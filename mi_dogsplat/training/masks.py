"""Masks: which pixels of a training image count. What moves, or is no part of the scene, is painted black."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from ..datasets.dataset import View
from ..datasets.images import read_image
from ..errors import DataError

SUFFIXES = (".png", ".jpg.png", ".jpeg.png", ".JPG.png", ".png.png", ".jpg")  # COLMAP appends .png to the image's name
USED = 0.5  # grey level from which a pixel counts


def find_masks(folder: Path, views: Sequence[View]) -> list[Path | None]:
    """The mask of each view: a file of its name in a folder. Raises ``DataError`` if there is none for any of them."""
    if not folder.is_dir():
        raise DataError(folder, "no such folder", "give a folder with a mask per image")
    candidates = [[folder / (view.name + suffix) for suffix in SUFFIXES] for view in views]
    found = [next((path for path in paths if path.is_file()), None) for paths in candidates]
    if not any(found):
        remedy = f"name them as the images, like {views[0].name}.png"
        raise DataError(folder, "has no mask for any training image", remedy)
    return found


def read_mask(path: Path, width: int, height: int) -> np.ndarray:
    """float32 [H, W]: 1 where a pixel counts, 0 where the mask is black; of any size, scaled to that of its view.

    Raises ``DataError``.
    """
    grey = read_image(path)[..., :3].mean(axis=2)  # [H', W']
    if grey.shape != (height, width):
        whole = Image.fromarray((grey * 255).astype(np.uint8))
        grey = np.asarray(whole.resize((width, height), Image.Resampling.BOX), np.float32) / 255
    return (grey >= USED).astype(np.float32)
