"""Colours of a video's frames as sRGB, which photographs are in.

A file says how its luma and chroma were made of RGB, by which curve RGB was made of light, and which primaries it has.
HDR of phones has another curve and primaries than sRGB, and looks pale where nobody takes that into account. ffmpeg's
own conversion goes by a table, by which saturated colours were up to 50 of 255 levels off.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..datasets.color_profiles import Encoding, as_srgb
from ..datasets.primaries import BT2020, WIDE, srgb_levels, xyz_of
from ..support.errors import DataError

BT709, UNSPECIFIED = 1, 2  # matrices of ISO/IEC 23091-2, as ffmpeg numbers them
MATRICES = (0, BT709, UNSPECIFIED, 4, 5, 6, 7, 9)  # those that ffmpeg converts
OTHERS = {8: "YCgCo", 10: "BT.2020 of constant luminance", 14: "ICtCp"}
PQ, HLG = 16, 18  # transfer functions, in the same table
HD_WIDTH, SD_HEIGHT = 1280, 576  # what does not say is BT.709 from there on and above, as in players
# ffmpeg's shortcuts from chroma of half the size to 8 bits are 1 to 2 levels too dark; this way through it rounds
WHOLE_CHROMA, PLANES = "yuv444p10le", "gbrp"
WHITE_NITS = 203.0  # light of diffuse white in HDR (ITU-R BT.2408)
PEAK_NITS, SYSTEM_GAMMA = 1000.0, 1.2  # of the screen that HLG is shown on (BT.2100)


def require_colors(path: Path, frame: Any, remedy: str) -> None:
    """Raise ``DataError`` for a video with this ``av.VideoFrame`` whose colours ``srgb_of`` cannot make."""
    matrix = int(frame.colorspace)
    if matrix not in MATRICES and not frame.format.is_rgb:
        name = OTHERS.get(matrix, f"the matrix {matrix} of ITU-T H.273")
        raise DataError(path, f"its colours are coded by {name}, which is not read", remedy)


def srgb_of(frame: Any, width: int) -> NDArray[np.uint8]:
    """An ``av.VideoFrame`` as sRGB [H, W, 3], ``width`` pixels wide. HDR keeps diffuse white, and clips above.

    Other video has the curve of sRGB, as screens show it, whichever it says that cameras have.
    """
    matrix = _matrix(frame)
    shape: dict[str, Any] = {"width": width, "height": frame.height, "src_colorspace": matrix}
    curve, primaries = frame.color_trc, WIDE.get(frame.color_primaries)
    if curve not in (PQ, HLG):
        if not frame.format.is_rgb and len(frame.format.components) > 1:
            frame = frame.reformat(format=WHOLE_CHROMA, dst_colorspace=matrix, **shape)
        pixels = frame.to_ndarray(format=PLANES, **shape)
        if primaries is None:
            return pixels
        return np.asarray(as_srgb(Image.fromarray(pixels), Encoding(primaries)))
    primaries = primaries or BT2020
    signal = frame.to_ndarray(format="rgb48le", **shape)  # uint16 [H, W, 3]
    light = _light(curve)[signal]
    if curve == HLG:
        light *= (light @ xyz_of(primaries)[1].astype(np.float32))[..., None] ** np.float32(SYSTEM_GAMMA - 1)
        light *= np.float32(PEAK_NITS / WHITE_NITS)
    return srgb_levels(light, primaries)


def _matrix(frame: Any) -> int:
    said = int(frame.colorspace)
    if said != UNSPECIFIED:
        return said
    return BT709 if frame.width >= HD_WIDTH or frame.height > SD_HEIGHT else UNSPECIFIED


@lru_cache
def _light(curve: int) -> NDArray[np.float32]:
    """float32 [65536], of each 16-bit signal: for PQ light over that of diffuse white, for HLG that of the scene."""
    signal = np.arange(65536) / 65535
    if curve == PQ:  # SMPTE ST 2084
        root = signal ** (1 / 78.84375)
        light = (np.maximum(root - 0.8359375, 0) / (18.8515625 - 18.6875 * root)) ** (1 / 0.1593017578125)
        return (10000 / WHITE_NITS * light).astype(np.float32)
    a, b, c = 0.17883277, 0.28466892, 0.55991073  # BT.2100
    return np.where(signal <= 0.5, signal**2 / 3, (np.exp((signal - c) / a) + b) / 12).astype(np.float32)
