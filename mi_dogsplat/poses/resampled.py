"""Pixels that were resampled, in a file of the kind that they come from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from ..datasets.images import straight_color
from ..support.files import replacing

QUALITY = {"quality": 98, "subsampling": 0}  # of JPEG: the pixels have been compressed before


def write_resampled(pixels: np.ndarray, target: Path) -> None:
    """Write display values [H, W, 3], or [H, W, 4] premultiplied, as JPEG or else PNG, by the name of the file."""
    if pixels.shape[2] == 4:  # PNG is not premultiplied
        pixels = np.concatenate([straight_color(pixels[..., :3], pixels[..., 3:]), pixels[..., 3:]], axis=2)
    image = Image.fromarray(np.rint(np.clip(pixels, 0, 1) * 255).astype(np.uint8))
    with replacing(target) as part:
        if target.suffix.lower() in (".jpg", ".jpeg"):
            image.save(part, "JPEG", **QUALITY)
        else:
            image.save(part, "PNG")
