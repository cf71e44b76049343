"""Images of Blender as files that Mitsuba reads without knowing where they came from: PPM of bytes, PFM of floats.

Textures have their first row at v = 0, where Blender has it too, and so need no turning of texture coordinates; an
environment has it at the top.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..files.srgb import decoded
from .export import Export, Plugin


def bitmap(export: Export, image: bpy.types.Image, channel: str = "Color", factor: float = 1.0) -> Plugin | None:
    """A texture of one image; None, with a note, where it has no pixels.

    channel: ``Alpha`` for that alone. factor: multiplies linear colours, which then are floats.
    """
    pixels = _pixels(export, image)
    if pixels is None:
        return None
    if channel == "Alpha":
        return {"type": "bitmap", "filename": _write_floats(export, pixels[..., 3:]), "raw": True}
    encoded = _is_encoded(image)
    if image.is_float or factor != 1:
        linear = decoded(pixels[..., :3]) if encoded else pixels[..., :3]
        return {"type": "bitmap", "filename": _write_floats(export, linear * factor), "raw": True}
    return {"type": "bitmap", "filename": _write_bytes(export, pixels[..., :3]), "raw": not encoded}


def environment(export: Export, image: bpy.types.Image) -> str | None:
    """The file of an environment, in linear radiance."""
    pixels = _pixels(export, image)
    if pixels is None:
        return None
    linear = decoded(pixels[..., :3]) if _is_encoded(image) else pixels[..., :3]
    return _write_floats(export, linear[::-1])


def write_gray(export: Export, values: np.ndarray) -> Plugin:
    """A texture of one channel, [H, W]."""
    return {"type": "bitmap", "filename": _write_floats(export, values[..., None]), "raw": True}


def _is_encoded(image: bpy.types.Image) -> bool:
    """Floats are linear once they are loaded, bytes as their colour space says."""
    return not image.is_float and image.colorspace_settings.name.startswith("sRGB")


def _pixels(export: Export, image: bpy.types.Image) -> np.ndarray | None:
    """[H, W, 4] float32, from the bottom."""
    width, height = image.size
    if not width or not height:
        export.note('the image "{image}" has no pixels; it is left out', image=image.name)
        return None
    if image.source == "TILED":
        export.note('of the tiles of the image "{image}" only one is drawn', image=image.name)
    elif image.source in ("SEQUENCE", "MOVIE"):
        export.note('of the frames of the image "{image}" only one is drawn', image=image.name)
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)


def _write_floats(export: Export, values: np.ndarray) -> str:
    """PFM, whose own first row is the bottom one; ``values`` [H, W, 1 or 3] are in the order of Mitsuba."""
    height, width, channels = values.shape
    header = f"{'PF' if channels == 3 else 'Pf'}\n{width} {height}\n-1.0\n".encode()
    return export.write(header + np.ascontiguousarray(values[::-1], "<f4").tobytes(), ".pfm")


def _write_bytes(export: Export, values: np.ndarray) -> str:
    """PPM."""
    height, width, _ = values.shape
    levels = (values.clip(0, 1) * 255 + 0.5).astype(np.uint8)
    return export.write(f"P6\n{width} {height}\n255\n".encode() + levels.tobytes(), ".ppm")
