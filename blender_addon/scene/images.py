"""Images of Blender as files that Mitsuba reads without knowing where they came from: PPM of bytes, PFM of floats.

Textures have their first row at v = 0, where Blender has it too, and so need no turning of texture coordinates; an
environment has it at the top.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..files.srgb import decoded, encoded
from ..objects.working_space import from_working, working_space
from .export import Export, Plugin
from .written_images import WRITTEN

LINEAR = ("Linear", "ACES2065-1", "ACEScg", "scene_linear")  # how names of linear color spaces begin
DRAWN = "sRGB", "Linear Rec.709", "scene_linear"  # color spaces of bytes


def bitmap(
    export: Export, image: bpy.types.Image, channel: str = "Color", factor: float = 1.0, alpha_used: bool = False
) -> Plugin | None:
    """A texture of one image; None, with a note, where it has no pixels.

    channel: ``Alpha`` for that alone. factor: multiplies linear colours; bytes become floats where they would be too
    coarse. alpha_used: as in ``_by_alpha``.
    """
    if not _has_pixels(export, image):
        return None
    alpha = channel == "Alpha"
    floats = alpha or image.is_float or not 0.5 <= factor <= 1

    def write() -> str:
        pixels = pixels_of(image)
        if alpha:
            return write_floats(export, pixels[..., 3:])
        if floats:
            return write_floats(export, _linear(image, _by_alpha(image, pixels, alpha_used)) * factor)
        return _write_bytes(export, _dimmed(image, _by_alpha(image, pixels, alpha_used), factor))

    name = WRITTEN.file_of(export, image, (channel, factor, alpha_used, working_space()), write)
    return {"type": "bitmap", "filename": name, "raw": floats or not _is_encoded(image)}


def environment(export: Export, image: bpy.types.Image) -> str | None:
    """The file of an environment, in linear radiance."""
    if not _has_pixels(export, image):
        return None

    def write() -> str:
        return write_floats(export, _linear(image, pixels_of(image))[::-1])

    return WRITTEN.file_of(export, image, ("Environment", working_space()), write)


def write_gray(export: Export, values: np.ndarray) -> Plugin:
    """A texture of one channel, [H, W]."""
    return {"type": "bitmap", "filename": write_floats(export, values[..., None]), "raw": True}


def _by_alpha(image: bpy.types.Image, pixels: np.ndarray, alpha_used: bool) -> np.ndarray:
    """Colours [H, W, 3] as Blender's engines take them: multiplied by alpha, unless a node takes that too.

    Blender keeps bytes without their alpha, and floats with it. Alpha that is none, and numbers that are no colours,
    change nothing.
    """
    colors, alpha = pixels[..., :3], pixels[..., 3:]
    if image.colorspace_settings.is_data or image.alpha_mode in ("NONE", "CHANNEL_PACKED"):
        return colors
    if image.is_float:
        return colors / np.where(alpha == 0, 1, alpha) if alpha_used else colors
    return colors if alpha_used else colors * alpha


def _dimmed(image: bpy.types.Image, colors: np.ndarray, factor: float) -> np.ndarray:
    """Colours [H, W, 3] of bytes times a factor up to 1, in the encoding that they have."""
    if factor == 1:
        return colors
    return encoded(decoded(colors) * factor) if _is_encoded(image) else colors * factor


def _linear(image: bpy.types.Image, pixels: np.ndarray) -> np.ndarray:
    """Colours [H, W, 3] of pixels as linear ones of Rec. 709; numbers that are no colours as they are."""
    colors = pixels[..., :3]
    if image.is_float and not image.colorspace_settings.is_data:
        return from_working(colors)
    return decoded(colors) if _is_encoded(image) else colors


def _is_encoded(image: bpy.types.Image) -> bool:
    """Floats are linear once they are loaded, in the working space; bytes as their colour space says."""
    space = image.colorspace_settings
    return not (image.is_float or space.is_data or space.name.startswith(LINEAR))


def _has_pixels(export: Export, image: bpy.types.Image) -> bool:
    """With a note where it has none, or more than are drawn, or colours of another space."""
    if not all(image.size):
        export.note('the image "{image}" has no pixels; it is left out', image=image.name)
        return False
    if image.source == "TILED":
        export.note('of the tiles of the image "{image}" only one is drawn', image=image.name)
    elif image.source in ("SEQUENCE", "MOVIE"):
        export.note('of the frames of the image "{image}" only one is drawn', image=image.name)
    space = image.colorspace_settings
    if not (image.is_float or space.is_data or space.name in DRAWN):
        drawn = DRAWN[0] if _is_encoded(image) else DRAWN[1]
        export.note('the image "{image}" is drawn as one in {drawn}, not in {space}', image=image.name,
                    drawn=drawn, space=space.name)  # fmt: skip
    return True


def pixels_of(image: bpy.types.Image) -> np.ndarray:
    """[H, W, 4] float32, from the bottom."""
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)


def write_floats(export: Export, values: np.ndarray) -> str:
    """PFM, whose own first row is the bottom one; ``values`` [H, W, 1 or 3] are in the order of Mitsuba."""
    height, width, channels = values.shape
    header = f"{'PF' if channels == 3 else 'Pf'}\n{width} {height}\n-1.0\n".encode()
    return export.write(header + np.ascontiguousarray(values[::-1], "<f4").tobytes(), ".pfm")


def _write_bytes(export: Export, values: np.ndarray) -> str:
    """PPM."""
    height, width, _ = values.shape
    levels = (values.clip(0, 1) * 255 + 0.5).astype(np.uint8)
    return export.write(f"P6\n{width} {height}\n255\n".encode() + levels.tobytes(), ".ppm")
