"""Raw photographs, developed by LibRaw (rawpy, of the extra ``poses``): levels of a sensor become linear light.

Programs that develop photographs for people choose white balance, brightness and curve for each picture. Here all of
that is given from outside or left out, so that one surface looks alike in all photographs.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..datasets.photograph_names import RAW
from ..support.errors import DataError
from .exif import tags_of

TIFF = (b"II*\0", b"MM\0*")  # how most raw files begin, DNG among them
SATURATED = 65535  # the level that a sensor's largest becomes
FULL = 0.95  # of it: from here on a channel may have been at the end of its range, which no two of a sensor share
Balance = tuple[float, float, float]


@dataclass(frozen=True)
class RawHeader:
    """What a raw file says beside its pixels.

    ``tags``: of EXIF. ``balance``: factors of red, green and blue that make what the camera took for white grey, or
    what is white by day where it does not say; green has 1. ``exposure``: light on the sensor times its gain, relative
    to that of a second, ISO 100 and f/1, which stand for what it does not say; None where it says no time. ``said``:
    whether it says ISO and aperture.
    """

    tags: dict[int, Any]
    balance: Balance
    exposure: float | None
    said: tuple[bool, bool]


def is_raw(path: Path) -> bool:
    """Whether a file is called like a raw photograph."""
    return path.suffix.lower() in RAW


def read_header(path: Path) -> RawHeader:
    """Without the pixels. Raises ``DataError``."""
    with _opened(path) as raw:
        known = (balance[:3] for balance in (raw.camera_whitebalance, raw.daylight_whitebalance, [1, 1, 1]))
        red, green, blue = next(balance for balance in known if min(balance) > 0)
        taken = raw.other
        exposure = taken.shutter_speed * (taken.iso_speed or 100) / 100 / (taken.aperture or 1) ** 2
        said = bool(taken.iso_speed), bool(taken.aperture)
        return RawHeader(_tags(path, raw), (red / green, 1.0, blue / green), exposure or None, said)


def develop(path: Path, balance: Balance, half: bool = False) -> NDArray[np.float32]:
    """Linear light [H, W, 3] in sRGB's primaries, upright: 1 where the sensor is full, and nothing above it.

    Args:
        balance: as in ``RawHeader``.
        half: a pixel for four of the sensor's, which is faster.

    Raises ``DataError``.
    """
    with _opened(path) as raw:
        import rawpy

        levels = raw.postprocess(
            user_wb=[*balance, balance[1]], half_size=half, output_bps=16, gamma=(1, 1), no_auto_bright=True,
            adjust_maximum_thr=0, output_color=rawpy.ColorSpace.sRGB, highlight_mode=rawpy.HighlightMode.Clip,
        )  # fmt: skip
    return levels.astype(np.float32) / SATURATED


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A raw file of rawpy's. What that raises becomes a ``DataError``."""
    import rawpy

    try:
        with path.open("rb") as file, rawpy.imread(file) as raw:
            yield raw
    except (rawpy.LibRawError, rawpy.NotSupportedError, OSError) as error:
        said = error.args[0] if error.args else error
        problem = f"cannot be read as a raw photograph ({said.decode() if isinstance(said, bytes) else said})"
        raise DataError(path, problem, "replace the file or remove it, or export all of them as JPEG") from error


def _tags(path: Path, raw: Any) -> dict[int, Any]:
    """Those of the file itself, or of the preview in it; none where neither has any that Pillow reads."""
    with path.open("rb") as file:
        if file.read(4) in TIFF:
            file.seek(0)
            exif = Image.Exif()
            with warnings.catch_warnings():  # of tags that Pillow does not expect, as cameras write them
                warnings.simplefilter("ignore")
                exif.load_from_fp(file)
                return tags_of(lambda: exif)
    import rawpy

    try:
        preview = raw.extract_thumb()
    except (rawpy.LibRawError, rawpy.NotSupportedError):
        return {}
    if preview.format != rawpy.ThumbFormat.JPEG:
        return {}
    return tags_of(lambda: Image.open(io.BytesIO(preview.data), formats=("JPEG",)).getexif())
