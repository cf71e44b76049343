"""Pictures inside a report: read from files, embedded, captioned, with a close-up of where it matters."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

MAX_SIDE = 900  # pixels; larger pictures are scaled down in the page, the files keep their size
ZOOM = 4  # a close-up is 1/4 of the picture in every direction


@dataclass(frozen=True)
class Figure:
    """A captioned picture: its ``source`` is that of an image element, its ``size`` gives the aspect ratio.

    ``marks`` are frames over it, as ``frame`` makes them.
    """

    caption: str
    source: str
    size: tuple[int, int]
    marks: Sequence[Mapping[str, float]] = ()


def read_pictures(files: Mapping[str, Path]) -> tuple[dict[str, Image.Image], list[str]]:
    """The pictures that could be read, by what they show, and the names of the other files."""
    pictures: dict[str, Image.Image] = {}
    missing = []
    for what, path in files.items():
        try:
            with Image.open(path, formats=("PNG",)) as image:
                pictures[what] = image.convert("RGB")
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):  # what Pillow raises for bad files
            missing.append(path.name)
    return pictures, missing


def worst_box(error: NDArray[np.float64]) -> tuple[int, int, int, int]:
    """Left, top, width, height of the window of 1/`ZOOM` of the picture [H, W] that holds the most error."""
    height, width = error.shape
    h, w = max(1, height // ZOOM), max(1, width // ZOOM)
    sums = np.pad(error, ((1, 0), (1, 0))).cumsum(0).cumsum(1)  # [H + 1, W + 1]
    totals = sums[h:, w:] - sums[:-h, w:] - sums[h:, :-w] + sums[:-h, :-w]  # [H - h + 1, W - w + 1]
    top, left = np.unravel_index(int(np.argmax(totals)), totals.shape)
    return int(left), int(top), w, h


def frame(box: tuple[float, float, float, float], size: tuple[int, int]) -> dict[str, float]:
    """Left, top, width and height of ``box``, pixels of a picture of ``size``, in percent of it."""
    sides = ("left", "top", "width", "height")
    return {side: 100 * v / s for side, v, s in zip(sides, box, (*size, *size), strict=True)}


def embedded_jpeg(picture: Image.Image) -> str:
    """The source of an image element; at most `MAX_SIDE` pixels high and wide."""
    small = picture.copy()
    small.thumbnail((MAX_SIDE, MAX_SIDE), Image.Resampling.LANCZOS)
    data = io.BytesIO()
    # Without optimize=True: then Pillow has room for a byte per pixel, which a noisy picture exceeds, and raises.
    small.save(data, "JPEG", quality=90, subsampling=0)
    return "data:image/jpeg;base64," + base64.b64encode(data.getvalue()).decode()


def embedded_png(picture: Image.Image) -> str:
    """The source of an image element, without loss."""
    data = io.BytesIO()
    picture.save(data, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()
