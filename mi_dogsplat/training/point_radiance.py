"""Radiance of the points that a training starts from, where images are linear: points of a reconstruction are not.

Their colours are display values of 8 bits, in an exposure that nobody knows (that of the pictures that structure from
motion saw), and clipped. So they are made linear and brought to the brightness that the images show at the points.
Those that are clipped get what the images show where they are.
"""

from __future__ import annotations

import numpy as np

from ..datasets.dataset import Dataset
from ..support.srgb import luminance, srgb_to_linear

MAX_VIEWS = 24  # that are looked at
CLIPPED, DARK = 0.98, 0.02  # display values that tell nothing of brightness


def point_radiance(dataset: Dataset) -> np.ndarray:
    """[P, 3] in units of white, for a data set of linear images."""
    colors = dataset.point_colors.astype(np.float64)
    linear = srgb_to_linear(colors).astype(np.float64)
    seen = _seen(dataset)  # [P, 3], NaN where no view sees a point
    told = (colors.max(axis=1) < CLIPPED) & (colors.max(axis=1) > DARK) & np.isfinite(seen).all(axis=1)
    gain = 1.0
    if told.any():
        gain = float(np.median(luminance(seen[told]) / luminance(linear[told])))
    found = gain * linear
    clipped = (colors.max(axis=1) >= CLIPPED) & np.isfinite(seen).all(axis=1)
    found[clipped] = np.maximum(found[clipped], seen[clipped])
    return found


def _seen(dataset: Dataset) -> np.ndarray:
    """[P, 3] median over views of what they show at each point, in units of white; NaN where none does.

    Views that are saturated there only say how bright a point is at least.
    """
    views = dataset.train[:: -(-len(dataset.train) // MAX_VIEWS)]
    shown, least = np.full((2, len(views), len(dataset.points), 3), np.nan, np.float32)
    for k, view in enumerate(views):
        pixels, depth = view.camera.project(dataset.points)
        with np.errstate(invalid="ignore"):
            inside = (depth > 0) & (pixels >= 0).all(axis=1)
            inside &= (pixels < (view.camera.width, view.camera.height)).all(axis=1)
        column, line = pixels[inside].astype(np.int64).T
        recording = view.recording
        color = recording.image[line, column, :3] / np.float32(view.white or 1.0)
        full = np.zeros(len(line), bool) if recording.saturated is None else recording.saturated[line, column]
        shown[k, inside] = np.where(full[:, None], np.nan, color)
        least[k, inside] = np.where(full[:, None], color, np.nan)
    found = np.full((len(dataset.points), 3), np.nan)
    told, bounded = (np.isfinite(of_views[..., 0]).any(axis=0) for of_views in (shown, least))
    found[told] = np.nanmedian(shown[:, told], axis=0)
    found[bounded & ~told] = np.nanmax(least[:, bounded & ~told], axis=0)
    return found
