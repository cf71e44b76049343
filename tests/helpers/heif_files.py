"""HEIF files as phones write them: by pillow-heif, whose decoder our reader has, and whose encoder is x265."""

from pathlib import Path

import numpy as np
import pytest

pillow_heif = pytest.importorskip("pillow_heif", reason="needs pillow-heif: pip install 'mi_dogsplat[poses]'")


def write_heif(path: Path, pixels: np.ndarray, **said) -> Path:
    """Pixels [H, W, 3 or 4] as they lie in the file, in 4:4:4 and next to no loss; ``said`` as pillow-heif takes it:
    ``exif`` (whose orientation is written as a property, too), ``xmp``, ``icc_profile``, ``tile_size``, and the numbers
    ``color_primaries`` and ``transfer_characteristics``."""
    mode = "RGB" if pixels.shape[2] == 3 else "RGBA"
    size = pixels.shape[1], pixels.shape[0]
    pillow_heif.encode(mode, size, pixels.tobytes(), path, quality=100, chroma=444, **said)
    return path


def assert_shows(found: np.ndarray, expected: np.ndarray) -> None:
    """That images of values in 0..1 are the same but for the compression."""
    assert found.shape == expected.shape
    assert np.abs(found - expected).mean() < 0.01


def picture() -> np.ndarray:
    """[64, 96, 3], blocks of random colours, no two sides of which are alike."""
    blocks = np.random.default_rng(0).integers(0, 256, (4, 6, 3))
    return np.kron(blocks, np.ones((16, 16, 1))).astype(np.uint8)
