"""Masks: which pixels of an image count, in training and in metrics.

What moves, or is no part of the scene, is painted black.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from ..errors import DataError
from .dataset import View
from .images import read_image

SUFFIXES = (".png", ".jpg.png", ".jpeg.png", ".JPG.png", ".png.png", ".jpg")  # COLMAP appends .png to the image's name
USED = 0.5  # grey level from which a pixel counts


class Masks:
    """A folder with a picture per image, named as the image; images without one count whole.

    Raises ``DataError`` if there is no such folder, or none for any of the ``views``.
    """

    def __init__(self, folder: str | Path, views: Sequence[View]):
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise DataError(self.folder, "no such folder", "give a folder with a mask per image")
        if not any(self._path(view) for view in views):
            remedy = f"name them as the images, like {views[0].name}.png"
            raise DataError(self.folder, "has no mask for any of the images", remedy)

    def of(self, view: View) -> np.ndarray | None:
        """The mask of a view, as ``read_mask`` gives it; None where it counts whole."""
        path = self._path(view)
        return None if path is None else read_mask(path, view.camera.width, view.camera.height)

    def _path(self, view: View) -> Path | None:
        candidates = (self.folder / (view.name + suffix) for suffix in SUFFIXES)
        return next((path for path in candidates if path.is_file()), None)


def read_mask(path: Path, width: int, height: int) -> np.ndarray:
    """float32 [H, W]: 1 where a pixel counts, 0 where the mask is black; of any size, scaled to that of its view.

    Raises ``DataError``.
    """
    grey = read_image(path)[..., :3].mean(axis=2)  # [H', W']
    if grey.shape != (height, width):
        whole = Image.fromarray((grey * 255).astype(np.uint8))
        grey = np.asarray(whole.resize((width, height), Image.Resampling.BOX), np.float32) / 255
    return (grey >= USED).astype(np.float32)
