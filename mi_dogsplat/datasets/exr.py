"""OpenEXR files as pictures: linear radiance of any range, premultiplied where there is alpha.

- **Parts and layers.** Read are the channels R, G, B and A without a layer name, of the first part that has them; else
  those of a layer, if just one has them; else Y, as grey. Everything else (depth, normals) is passed over.
- **Windows.** The picture is the display window. What the data window leaves out of it is black and transparent, and
  what lies outside of it is cut off.
- **Saturation.** The attribute ``sensorSaturation`` says from which value on the sensor that took the picture was full.
- Half and float values, scan lines and tiles, and every compression of the library are read. Negative values, which
  filters and denoisers leave behind, become 0, as there is no negative light.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from ..support.errors import DataError
from ..support.pictures import SATURATION
from .claimed_size import require_photograph

SUFFIX = ".exr"
REMEDY = "write it again with channels R, G, B as half or float"
UNREADABLE = (RuntimeError, OSError, ValueError, TypeError)  # what the library raises for bad files


def is_exr(path: Path) -> bool:
    """Whether a file is named as one."""
    return path.suffix.lower() == SUFFIX


def exr_header(path: Path) -> tuple[tuple[int, int], bool]:
    """((width, height), whether there is alpha) of a picture, without its pixels. Raises ``DataError``."""
    file = _opened(path, header_only=True)
    part, names = _choice(path, file)
    return _size(path, file.parts[part].header), len(names) == 4


def exr_saturation(path: Path) -> float | None:
    """The value of a channel from which on the sensor was full, so that the scene may be brighter; None where the file
    names none. Raises ``DataError``."""
    file = _opened(path, header_only=True)
    part, _ = _choice(path, file)
    named = file.parts[part].header.get(SATURATION)
    if named is None:
        return None
    if not isinstance(named, (int, float)) or not math.isfinite(named) or named <= 0:
        problem = f"has the attribute {SATURATION} = {named}, which is no radiance above 0"
        raise DataError(path, problem, "remove the attribute, or make it the value of a full sensor")
    return float(named)


def read_exr(path: Path) -> np.ndarray:
    """Linear radiance float32 [H, W, 3], or [H, W, 4] premultiplied. Raises ``DataError``."""
    headers = _opened(path, header_only=True)
    part, names = _choice(path, headers)
    unpacked = _unpacked(path, headers, part)
    header, channels = unpacked.header, unpacked.channels
    width, height = _size(path, header)
    planes = [channels[name] for name in names]
    if any(plane.xSampling != 1 or plane.ySampling != 1 for plane in planes):
        raise DataError(path, "has channels of fewer pixels than others", REMEDY)
    if any(plane.pixels.dtype.kind != "f" for plane in planes):
        raise DataError(path, f"has whole numbers in {', '.join(names)}", REMEDY)
    data = np.stack([plane.pixels for plane in planes], axis=-1).astype(np.float32)  # [h, w, C] of the data window
    if broken := np.count_nonzero(~np.isfinite(data)):
        problem = f"has values that are NaN or infinite: {broken} of {data.size}"
        raise DataError(path, problem, "render it again, or clamp it below 65504 before it becomes half floats")
    data = np.maximum(data, 0)
    if data.shape[2] == 4:
        data[..., 3] = np.minimum(data[..., 3], 1)
    pixels = _in_display_window(data, header, width, height)
    return np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels


def read_exr_planes(path: Path) -> dict[str, np.ndarray]:
    """All channels of the first part, by their names with their layers: float32 [H, W] of the display window, 0 where
    nothing is stored. They may hold anything, also NaN. Raises ``DataError``."""
    headers = _opened(path, header_only=True)
    part = _unpacked(path, headers, 0)
    width, height = _size(path, part.header)
    shown = {}
    for name, plane in part.channels.items():
        if plane.xSampling == plane.ySampling == 1:
            data = plane.pixels.astype(np.float32)[..., None]
            shown[name] = _in_display_window(data, part.header, width, height)[..., 0]
    return shown


def _unpacked(path: Path, headers: Any, part: int) -> Any:
    """A part with its pixels, of a file whose ``headers`` claim no absurd sizes."""
    _size(path, headers.parts[part].header)
    for held in headers.parts:  # all are unpacked
        _size(path, held.header, "dataWindow")
    file = _opened(path, header_only=False)
    if len(file.parts) <= part:  # how the library leaves a file whose pixels it cannot read
        raise DataError(path, "is damaged: its pixels end early or cannot be unpacked", "replace the file")
    return file.parts[part]


def _opened(path: Path, header_only: bool) -> Any:
    try:
        return OpenEXR.File(str(path), separate_channels=True, header_only=header_only)
    except UNREADABLE as error:
        raise DataError(path, f"cannot be read as OpenEXR ({error})", "replace the file") from None


def _choice(path: Path, file: Any) -> tuple[int, list[str]]:
    """(part, names of the channels R G B, R G B A, or Y) that are the picture."""
    layers, grey, listed = {}, {}, []
    for part, held in enumerate(file.parts):
        names = [channel.name for channel in held.header["channels"]]
        listed += names
        if held.header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile):
            continue
        for layer in [""] + sorted({name.rpartition(".")[0] + "." for name in names if "." in name}):
            if all(layer + channel in names for channel in "RGB"):
                layers[part, layer] = [layer + channel for channel in "RGBA" if layer + channel in names]
        if "Y" in names and not {"RY", "BY"} & set(names):
            grey[part] = ["Y"]
    plain = [place for place in layers if not place[1]]
    if plain:
        return plain[0][0], layers[plain[0]]
    if len(layers) == 1:
        ((part, _), names) = next(iter(layers.items()))
        return part, names
    if layers:
        several = ", ".join(layer.rstrip(".") for _, layer in layers)
        raise DataError(path, f"has several layers, and none is the picture: {several}", REMEDY)
    if grey:
        return next(iter(grey.items()))
    raise DataError(path, f"has no channels R, G, B or Y, but {', '.join(listed) or 'none'}", REMEDY)


def _window(header: dict[str, Any], name: str) -> tuple[int, int, int, int]:
    """Left, top, and one past the right and bottom."""
    (left, top), (right, bottom) = (corner.tolist() for corner in header[name])
    return left, top, right + 1, bottom + 1


def _size(path: Path, header: dict[str, Any], window: str = "displayWindow") -> tuple[int, int]:
    """Width and height of a window."""
    left, top, right, bottom = _window(header, window)
    width, height = right - left, bottom - top
    try:
        require_photograph(width, height, path.stat().st_size)
    except ValueError as error:
        raise DataError(path, str(error), "replace the file") from None
    return width, height


def _in_display_window(data: np.ndarray, header: dict[str, Any], width: int, height: int) -> np.ndarray:
    """The data window [h, w, C] as the display window [height, width, C]."""
    left, top, right, bottom = _window(header, "displayWindow")
    x, y, _, _ = _window(header, "dataWindow")
    if (x, y) == (left, top) and data.shape[:2] == (height, width):
        return data
    pixels = np.zeros((height, width, data.shape[2]), np.float32)
    x0, y0 = max(x, left), max(y, top)
    x1, y1 = min(x + data.shape[1], right), min(y + data.shape[0], bottom)
    if x0 < x1 and y0 < y1:
        pixels[y0 - top : y1 - top, x0 - left : x1 - left] = data[y0 - y : y1 - y, x0 - x : x1 - x]
    return pixels
