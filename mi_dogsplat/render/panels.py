"""Panels of a picture, each with a line of text below it that says what it is. Needs Pillow (extra "train")."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw, ImageFont

SIZE = 15  # of the letters, in pixels
WIDEST = 0.96  # share of the picture's width
WHITE, INK = (255, 255, 255), (20, 20, 20)


def labelled(picture: np.ndarray, text: str, size: float = SIZE) -> np.ndarray:
    """[H + 2.5 size, W, 3] of sRGB values, 0..1, with the text below, in smaller letters where it is too wide."""
    width, height = picture.shape[1], round(2.5 * size)
    font = ImageFont.load_default(size)
    while font.getlength(text) > WIDEST * width and size > 1:  # not in proportion to the size, which is hinted
        size *= 0.95
        font = ImageFont.load_default(size)
    canvas = Image.new("RGB", (width, height), WHITE)
    ImageDraw.Draw(canvas).text((width / 2, height / 2), text, INK, font, anchor="mm")
    return np.concatenate([picture, np.asarray(canvas) / 255.0])
