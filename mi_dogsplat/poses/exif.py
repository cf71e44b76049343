"""What a camera wrote into a photograph: which device it is, its focal length, and how it was held."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from PIL import ExifTags, Image

from ..datasets.heif import orientation_of
from ..datasets.images import TURNS
from .gravity import down_of

DIAGONAL_35MM = math.hypot(36, 24)  # mm; CIPA DC-008 compares fields of view by the diagonal
SAME_SHAPE = 0.02  # relative difference of the ratios of two sizes that are of one picture
DEVICE = (
    ExifTags.Base.Make, ExifTags.Base.Model, ExifTags.Base.LensModel, ExifTags.Base.FocalLength,
    ExifTags.Base.FocalLengthIn35mmFilm, ExifTags.Base.DigitalZoomRatio,  # a phone zooms by cutting out, at one size
)  # fmt: skip
QUARTER_TURNS = tuple(TURNS[value] for value in (5, 6, 7, 8))  # which exchange width and height
MM_PER_UNIT = {2: 25.4, 3: 10.0}  # FocalPlaneResolutionUnit: inch, centimetre


@dataclass(frozen=True)
class Exif:
    """``device``: equal for photographs of one camera at one focal length; ``focal`` in pixels, None if unknown.

    ``turn``: what is to be done to the pixels before they are shown, None for nothing. ``down``: where down was, a unit
    vector in the axes of the camera (OpenCV) whose picture is upright; None if the file does not say.
    """

    device: str
    focal: float | None
    turn: Image.Transpose | None
    down: tuple[float, ...] | None = None


def read_exif(image: Image.Image) -> Exif:
    """The tags of an image that has been opened. What makes no sense is taken as absent."""
    tags = tags_of(image.getexif)
    turn = TURNS.get(tags.get(ExifTags.Base.Orientation, 1))
    held = TURNS.get(orientation_of(image)) if turn is None else turn
    return replace(exif_of_upright(tags, image.size, image.info.get("xmp"), held), turn=turn)


def tags_of(exif: Callable[[], Image.Exif]) -> dict[int, Any]:
    """What ``exif`` holds at the top and in its EXIF directory; nothing where that cannot be read."""
    try:
        top = exif()
        return {**top, **top.get_ifd(ExifTags.IFD.Exif)}
    except (OSError, ValueError, SyntaxError, TypeError, KeyError):
        return {}


def exif_of_upright(tags: dict[int, Any], size: tuple[int, int], xmp: Any, held: Image.Transpose | None) -> Exif:
    """Of an image whose pixels need no turn.

    Args:
        tags: as of ``tags_of``.
        size: (width, height) of its pixels.
        xmp: bytes, if it has some.
        held: what made its pixels upright.
    """
    names = [str(tags.get(tag, "")).strip("\0 ") for tag in DEVICE]
    down = down_of(tags, xmp, held)
    known = None if down is None else tuple(down.tolist())
    return Exif(" ".join(filter(None, names)), _focal(tags, size), None, known)


def _focal(tags: dict[int, Any], size: tuple[int, int]) -> float | None:
    """Focal length in pixels of a picture of this size; None where the tags do not say, or it has been cropped."""
    taken = [_number(tags.get(tag)) for tag in (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight)]
    width, height = taken if all(taken) else size
    if abs(math.log((max(width, height) / min(width, height)) / (max(size) / min(size)))) > SAME_SHAPE:
        return None
    if equivalent := _number(tags.get(ExifTags.Base.FocalLengthIn35mmFilm)):
        return equivalent / DIAGONAL_35MM * math.hypot(*size)
    focal, density = (_number(tags.get(t)) for t in (ExifTags.Base.FocalLength, ExifTags.Base.FocalPlaneXResolution))
    unit = MM_PER_UNIT.get(tags.get(ExifTags.Base.FocalPlaneResolutionUnit, 2), 0.0)
    if focal and density and unit:
        pixels = focal * density / unit * max(size) / max(width, height)
        return pixels if 0.1 < pixels / max(size) < 100 else None
    return None


def _number(value: Any) -> float:
    """A positive number, or 0."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return 0.0
    return number if 0 < number < math.inf else 0.0
