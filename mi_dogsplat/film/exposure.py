"""A frame of a film: one picture, or the mean of some while the shutter is open."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..render.picture import Picture, premultiplied
from ..scene.cameras import Camera
from ..support.srgb import displayed, linear_to_srgb, srgb_to_linear


def exposed(
    picture: Callable[[Camera], Picture], cameras: Sequence[Camera], background: float, alpha: bool
) -> np.ndarray:
    """float32 [H, W, 3] over the grey ``background``, or premultiplied [H, W, 4] without it if ``alpha``; 0..1.

    Several cameras are the moments of one exposure: light adds up, so the mean is that of linear radiance, and comes
    back as display values.
    """
    if len(cameras) == 1:
        return _image(picture(cameras[0]), background, alpha)
    total: np.ndarray | float = 0.0
    white = None
    for camera in cameras:
        seen = picture(camera)
        if seen.radiance is not None and not alpha:  # not clamped yet
            total, white = total + seen.radiance, seen.white
            continue
        image = _image(seen, background, alpha)
        total = total + np.concatenate([srgb_to_linear(image[..., :3]), image[..., 3:]], axis=-1)
    mean = np.asarray(total) / len(cameras)
    if white is not None:
        return displayed(mean, white)
    return np.concatenate([linear_to_srgb(mean[..., :3]), mean[..., 3:]], axis=-1).astype(np.float32)


def _image(picture: Picture, background: float, alpha: bool) -> np.ndarray:
    return premultiplied(picture, background) if alpha else picture.color
