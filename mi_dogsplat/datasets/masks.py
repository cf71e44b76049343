"""Masks: which pixels of an image count, in training and in metrics.

What moves, or is no part of the scene, is painted black. A mask may be of any size.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from ..support.errors import DataError
from .dataset import View
from .images import box_downscale, read_image
from .named_like_images import composed, files_like_images, line_on_lacking, require_same_way
from .photograph_names import PLAIN

MOSTLY = 0.5  # of a view: if more of it is masked, its pose may be wrong, or the mask is of something else
USED = 0.5  # grey level from which a pixel counts
ONE = 1.01 / 255  # grey level of the number 1, in 8 bits and in more


class Masks:
    """A folder with a picture per image, named as the image (``named_like_images.py``); images without one count whole.

    Raises ``DataError`` if there is no such folder, or none for any of the ``views``, or two for one.
    """

    def __init__(self, folder: str | Path, views: Sequence[View]):
        folder = Path(folder)
        if not folder.is_dir():
            raise DataError(folder, "no such folder", "give a folder with a mask per image")
        self.folder, self.paths = folder, mask_files(folder)
        if not any(composed(view.name) in self.paths for view in views):
            raise no_mask(folder, views[0].name)

    def of(self, view: View) -> np.ndarray | None:
        """The mask of a view, float32 [H, W]: 1 where a pixel counts, else 0; None where it counts whole.

        A mask is one of the photograph: its lens is taken out as that of the photograph was. Raises ``DataError``.
        """
        grey, camera = self._grey(view), view.camera
        if grey is None:
            return None
        if view.straight:
            source = view.straight.source
            grey = view.straight.image(_resized(grey, source.width, source.height)[..., None])[..., 0]
        k = grey.shape[1] // camera.width  # as the image was downscaled, if it was: what is left over is cut off
        if k > 1 and grey.shape[0] // k == camera.height and grey.shape[1] // k == camera.width:
            grey = box_downscale(grey[..., None], k)[..., 0]
        return (_resized(grey, camera.width, camera.height) >= USED).astype(np.float32)

    def painted(self, view: View, width: int, height: int) -> np.ndarray | None:
        """The mask of a view on its photograph as it was taken, in this size: bool [H, W], True where a pixel counts;
        None where it counts whole. Raises ``DataError``."""
        grey = self._grey(view)
        return None if grey is None else _resized(grey, width, height) >= USED

    def _grey(self, view: View) -> np.ndarray | None:
        """[H', W'] of the file of a view, None where there is none. Raises ``DataError``."""
        path = self.paths.get(composed(view.name))
        if path is None:
            return None
        grey = read_image(path)[..., :3].mean(axis=2)
        require_white(path, float(grey.max()))
        source = view.straight.source if view.straight else view.camera
        require_same_way(path, (grey.shape[1], grey.shape[0]), (source.width, source.height))
        return grey


def mask_files(folder: Path) -> dict[str, Path]:
    """The masks of a folder, by the ``composed`` names of the views that they are of. Raises ``DataError`` for two of
    one view."""
    return files_like_images(folder, PLAIN, "mask")


def without_mask(folder: str | Path | None, views: Iterable[str]) -> list[str]:
    """A line on those views, by their names, that have no mask in the folder, as where its files are named otherwise;
    none where all have one, or without a folder."""
    if not folder:
        return []
    return line_on_lacking(Path(folder), mask_files(Path(folder)), views, "mask", "all of their pixels count")


def require_white(path: Path, brightest: float) -> None:
    """Raise ``DataError`` for a mask whose brightest pixel, 0..1, is the number 1: all of it would be black."""
    if 0 < brightest <= ONE:
        raise DataError(path, "has only 0 and 1, and both are black", "multiply it by 255: white is what counts")


def no_mask(folder: Path, view: str) -> DataError:
    """The error of a folder without a mask for any of the views, one of which is named."""
    return DataError(folder, "has no mask for any of the images", f"name them like the images, as {view}.png")


def all_black(folder: str | Path, views: str) -> DataError:
    """The error of masks that leave nothing of the ``views``, in words."""
    return DataError(folder, f"is black in every {views}", "paint white what counts, or leave out the masks")


def _resized(grey: np.ndarray, width: int, height: int) -> np.ndarray:
    """[H', W'] as [height, width], by means over boxes."""
    if grey.shape == (height, width):
        return grey
    whole = Image.fromarray((np.clip(grey, 0, 1) * 255).astype(np.uint8))
    return np.asarray(whole.resize((width, height), Image.Resampling.BOX), np.float32) / 255
