"""From the pixels in which a mask was found to those of the photograph as it was taken."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..datasets.dataset import View
from ..datasets.lens import Lens, Undistortion


def on_photograph(found: NDArray[np.bool_], view: View) -> NDArray[np.bool_]:
    """A mask [h, w] in the size of the photograph, which is that of the view, or that before its lens was taken out.

    What the pinhole of the view does not see of a photograph is not masked.
    """
    size = view.camera.width, view.camera.height
    if view.straight:
        x, y = _pinhole_pixels(view.straight, *found.shape[::-1])
        inside = (x >= 0) & (x < found.shape[1]) & (y >= 0) & (y < found.shape[0])
        found = inside & found[np.where(inside, y, 0), np.where(inside, x, 0)]
        size = view.straight.source.width, view.straight.source.height
    grey = Image.fromarray(np.where(found, 255, 0).astype(np.uint8)).resize(size, Image.Resampling.BILINEAR)
    return np.asarray(grey) >= 128


def _pinhole_pixels(straight: Undistortion, width: int, height: int) -> tuple[NDArray, NDArray]:
    """x and y [h, w], whole numbers, in a picture of this size by the pinhole: of the pixels of the photograph in the
    same size, -1 where the pinhole does not see them."""
    camera, source = straight.camera, straight.source
    scale = width / source.width, height / source.height
    focal, center = (source.fx * scale[0], source.fy * scale[1]), (source.cx * scale[0], source.cy * scale[1])
    rays = _rays(straight.lens, focal, center, width, height)
    x = (rays[..., 0] * camera.fx + camera.cx) * width / camera.width
    y = (rays[..., 1] * camera.fy + camera.cy) * height / camera.height
    sees = np.isfinite(x) & np.isfinite(y)
    x, y = (np.floor(np.where(sees, values, -1)).astype(int) for values in (x, y))
    return x, y


@lru_cache(maxsize=8)  # the photographs of a capture share a lens, and Newton's method takes as long as to read them
def _rays(
    lens: Lens, focal: tuple[float, float], center: tuple[float, float], width: int, height: int
) -> NDArray[np.float64]:
    """[h, w, 2] pinhole coordinates of the centres of the pixels of a photograph, width x height; NaN where no ray of a
    pinhole arrives."""
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)
    return lens.undistort((pixels - center) / focal)
