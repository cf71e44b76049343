"""Masks: which pixels of an image count, in training and in metrics.

What moves, or is no part of the scene, is painted black. A mask may be of any size.
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
        """The mask of a view, float32 [H, W]: 1 where a pixel counts, else 0; None where it counts whole.

        A mask is one of the photograph: its lens is taken out as that of the photograph was. Raises ``DataError``.
        """
        path = self._path(view)
        if path is None:
            return None
        grey, camera = read_image(path)[..., :3].mean(axis=2), view.camera  # [H', W']
        if view.straight:
            source = view.straight.source
            grey = view.straight.image(_resized(grey, source.width, source.height)[..., None])[..., 0]
        return (_resized(grey, camera.width, camera.height) >= USED).astype(np.float32)

    def _path(self, view: View) -> Path | None:
        candidates = (self.folder / (view.name + suffix) for suffix in SUFFIXES)
        return next((path for path in candidates if path.is_file()), None)


def _resized(grey: np.ndarray, width: int, height: int) -> np.ndarray:
    """[H', W'] as [height, width], by means over boxes."""
    if grey.shape == (height, width):
        return grey
    whole = Image.fromarray((np.clip(grey, 0, 1) * 255).astype(np.uint8))
    return np.asarray(whole.resize((width, height), Image.Resampling.BOX), np.float32) / 255
