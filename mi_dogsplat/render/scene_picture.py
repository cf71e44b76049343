"""A Mitsuba scene to a picture, as one of its sensors and its own integrator see it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from ..support.errors import DataError
from ..support.pictures import without_aovs
from ..support.srgb import linear_to_srgb
from .picture_memory import require_memory
from .scene_to_draw import SceneOptions, channel_names, pixels_of, scene_to_draw


def picture_of_scene(path: Path, options: SceneOptions, on_pass: Callable[[int, int], None] | None, suffix: str) -> Any:
    """The ``mi.Bitmap`` of a scene, with all channels of its film; type stubs lack what is used of it.

    Args:
        path, options: as of ``scene_to_draw``.
        on_pass: as of ``SceneToDraw.rendered``.
        suffix: of the file that is to be made of it, by which its memory is estimated.

    Needs a Mitsuba variant. Raises ``DataError``, also for what Mitsuba has to say about the scene.
    """
    drawn = scene_to_draw(path, options)
    width, height = map(int, drawn.sensor.film().crop_size())
    require_memory(path, width, height, suffix, "make its film smaller")
    return drawn.without_noise(drawn.rendered(on_pass))


def channels_of(bitmap: Any) -> dict[str, np.ndarray]:
    """What a ``mi.Bitmap`` holds: planes [H, W] by the names of its channels."""
    return dict(zip(channel_names(bitmap), np.moveaxis(pixels_of(bitmap), -1, 0), strict=True))


def shown(bitmap: Any, path: Path) -> np.ndarray:
    """sRGB values [H, W, 3] of the colours of a ``mi.Bitmap``. Raises ``DataError`` of the scene ``path`` for NaN."""
    rgb = without_aovs(bitmap).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    linear = np.array(rgb)  # [H, W, 3]
    if np.isnan(linear).any():
        raise DataError(path, "its render holds NaN", "correct the scene, or write .exr to see where they are")
    return linear_to_srgb(linear)
