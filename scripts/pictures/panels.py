"""Labelled panels side by side, as a PNG of the documentation: what the gallery is made of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"


def write_rows(name: str, rows: Sequence[Sequence[np.ndarray]], folder: Path = PICTURES) -> None:
    """Rows of panels, [H, W, 3] of sRGB values, all rows of one width; as few bytes as PNG has without a loss."""
    sheet = np.concatenate([np.concatenate(row, axis=1) for row in rows])
    Image.fromarray(np.round(255 * np.clip(sheet, 0, 1)).astype(np.uint8)).save(folder / name, optimize=True)
