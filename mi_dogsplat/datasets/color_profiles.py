"""Colours of an image file as sRGB, where its ICC profile says that they are others.

Phones photograph in Display P3, some cameras in Adobe RGB. The same numbers taken as sRGB are paler than the scene was.
"""

from __future__ import annotations

import io
from functools import lru_cache

import numpy as np
from PIL import Image, ImageCms

CHANNELS = slice(16, 20)  # of the header of a profile, by ICC.1
LEVELS = 6  # of each channel, in the colours by which a profile is compared with sRGB
EQUAL = 1  # of 255: so much profiles of sRGB differ by their own rounding


def as_srgb(image: Image.Image, profile: bytes | None) -> Image.Image:
    """An image of mode RGB or RGBA, whose colours are those of an ICC profile, in sRGB, clipped to what that can hold.

    The same image without a profile, with one of sRGB, of other channels than RGB, or one that cannot be used.
    """
    transform = _to_srgb(profile, image.mode) if profile else None
    return image if transform is None else ImageCms.applyTransform(image, transform) or image


@lru_cache(16)
def _to_srgb(profile: bytes, mode: str) -> ImageCms.ImageCmsTransform | None:
    """What converts pixels of a mode; None where it would change nothing, or cannot be had."""
    if profile[CHANNELS] != b"RGB ":
        return None
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        intent, flags = ImageCms.Intent.RELATIVE_COLORIMETRIC, ImageCms.Flags.BLACKPOINTCOMPENSATION
        srgb = ImageCms.createProfile("sRGB")
        transform = ImageCms.buildTransform(source, srgb, mode, mode, intent, flags)
        colors = _grid().convert(mode)
        changed = np.asarray(ImageCms.applyTransform(colors, transform), np.int16) - np.asarray(colors, np.int16)
    except (ImageCms.PyCMSError, OSError):
        return None
    return transform if abs(changed).max() > EQUAL else None


def _grid() -> Image.Image:
    steps = np.linspace(0, 255, LEVELS).round().astype(np.uint8)
    return Image.fromarray(np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(LEVELS, -1, 3))
