"""Pixels that were resampled or developed, in a file of the kind that its name says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from ..datasets.exr import is_exr
from ..datasets.images import straight_color
from ..support.files import replacing
from ..support.pictures import write_radiance

QUALITY = {"quality": 98, "subsampling": 0}  # of JPEG: the pixels have been compressed before


def write_resampled(pixels: np.ndarray, target: Path, saturation: float | None = None) -> None:
    """Write pixels [H, W, 3], or [H, W, 4] premultiplied: display values as JPEG or PNG, linear light as OpenEXR, with
    its ``saturation`` (``write_radiance``)."""
    if is_exr(target):
        return write_radiance(target, pixels, saturation)
    if pixels.shape[2] == 4:  # PNG is not premultiplied
        pixels = np.concatenate([straight_color(pixels[..., :3], pixels[..., 3:]), pixels[..., 3:]], axis=2)
    image = Image.fromarray(np.rint(np.clip(pixels, 0, 1) * 255).astype(np.uint8))
    with replacing(target) as part:
        if target.suffix.lower() in (".jpg", ".jpeg"):
            image.save(part, "JPEG", **QUALITY)
        else:
            image.save(part, "PNG")
