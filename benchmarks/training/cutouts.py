"""Things that stand in a photograph and are no part of the scene, pasted from pictures with alpha."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mi_dogsplat.support.errors import DataError
from PIL import Image

HEIGHTS = 0.25, 0.6  # of a thing, as shares of the photograph's
OUTSIDE = 0.2  # of its width or height may be outside of the photograph
TINTS = 0.4, 1.3  # by which its channels are multiplied, so that not all things have the colours of one
SEEN = 0.02  # coverage from which a pixel shows it


def pictures_of(folder: Path) -> list[Path]:
    """The .png of a folder. Raises ``DataError`` where there is none, or where the first has no alpha."""
    found = sorted(folder.glob("*.png"))
    if not found:
        raise DataError(folder, "holds no .png", "give a folder of pictures with alpha")
    with Image.open(found[0]) as first:
        if first.mode != "RGBA":
            raise DataError(found[0], f"is of the mode {first.mode}", "give pictures with alpha")
    return found


def with_a_thing(pixels: np.ndarray, cutouts: list[Path], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A photograph [H, W, 3] before which one of the things stands, and where it is seen [H, W]."""
    thing = _thing(cutouts[rng.integers(len(cutouts))], pixels.shape[0], rng)  # [h, w, 4], straight alpha
    layer = np.zeros((*pixels.shape[:2], 4))
    top, left = (
        int(rng.uniform(-OUTSIDE * size, whole - (1 - OUTSIDE) * size))
        for size, whole in zip(thing.shape[:2], pixels.shape[:2], strict=True)
    )
    rows, columns = (
        slice(max(at, 0), min(at + size, whole))
        for at, size, whole in zip((top, left), thing.shape[:2], pixels.shape[:2], strict=True)
    )
    layer[rows, columns] = thing[
        rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
    ]
    alpha = layer[..., 3:]
    return pixels * (1 - alpha) + layer[..., :3] * alpha, alpha[..., 0] > SEEN


def _thing(path: Path, height: int, rng: np.random.Generator) -> np.ndarray:
    """[h, w, 4] in 0..1, as large and of the colours that chance gives it."""
    with Image.open(path) as opened:
        cut = opened.crop(opened.getchannel("A").getbbox())
    scale = rng.uniform(*HEIGHTS) * height / cut.height
    size = max(1, round(cut.width * scale)), max(1, round(cut.height * scale))
    thing = np.asarray(cut.resize(size, Image.Resampling.LANCZOS), np.float64) / 255
    channels = rng.permutation(3)
    return np.concatenate([np.clip(thing[..., channels] * rng.uniform(*TINTS, 3), 0, 1), thing[..., 3:]], axis=2)
