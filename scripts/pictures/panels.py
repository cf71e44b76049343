"""Pictures with a line of text below them, side by side: what the gallery is made of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mi_dogsplat.support.pictures import write_png
from PIL import Image, ImageDraw, ImageFont

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
LABEL = 38  # pixels of the line below a picture


def labelled(picture: np.ndarray, text: str) -> np.ndarray:
    """[H + LABEL, W, 3] of sRGB values, with the text below."""
    width = picture.shape[1]
    canvas = Image.new("RGB", (width, LABEL), (255, 255, 255))
    ImageDraw.Draw(canvas).text((width / 2, LABEL / 2), text, (20, 20, 20), ImageFont.load_default(15), anchor="mm")
    return np.concatenate([picture, np.asarray(canvas) / 255.0])


def write_rows(name: str, rows: Sequence[Sequence[np.ndarray]]) -> None:
    """Rows of panels, all rows of one width, as a PNG among the pictures of the documentation."""
    write_png(PICTURES / name, np.concatenate([np.concatenate(row, axis=1) for row in rows]))
