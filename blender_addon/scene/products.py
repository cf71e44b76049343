"""Colours times numbers or textures: how much light leaves a surface that is there in part, or mixed with another."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..files.srgb import decoded
from .export import Export, Plugin, rgb
from .images import write_floats

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of Rec. 709: what Mitsuba takes for a number of a colour
PLACING = ("wrap_mode", "filter_type", "to_uv")


def product(export: Export, color: Plugin, factor: float | Plugin) -> Plugin | None:
    """A colour or texture times a number, or a texture of numbers; None for two textures that are laid differently."""
    if color["type"] == "rgb" and isinstance(factor, float):
        return rgb([value * factor for value in color["value"]])
    textures = [plugin for plugin in (color, factor) if isinstance(plugin, dict) and plugin["type"] == "bitmap"]
    if any(first.get(name) != textures[0].get(name) for first in textures for name in PLACING):
        return None
    values = _values(export.folder, color)
    if isinstance(factor, float):
        values = values * np.float32(factor)
    else:
        numbers = _values(export.folder, factor)
        numbers = numbers @ LUMINANCE if numbers.shape[-1] == 3 else numbers[..., 0]
        if color["type"] == "bitmap" and numbers.shape != values.shape[:2]:
            return None
        values = values * numbers[..., None]
    return textures[0] | {"filename": write_floats(export, values), "raw": True}


def _values(folder: Path, color: Plugin) -> np.ndarray:
    """Linear ones: [3] of a colour, [H, W, 1 or 3] of a texture that ``images.py`` has written."""
    if color["type"] == "rgb":
        return np.array(color["value"], np.float32)
    kind, size, depth, pixels = (folder / color["filename"]).read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    shape = (height, width, 1 if kind == b"Pf" else 3)
    if kind == b"P6":
        values = np.frombuffer(pixels, np.uint8).reshape(shape) / np.float32(int(depth))
    else:
        values = np.frombuffer(pixels, "<f4").reshape(shape)[::-1]
    return values if color["raw"] else decoded(values).astype(np.float32)
