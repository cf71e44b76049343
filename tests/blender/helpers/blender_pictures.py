"""Pictures that an engine of Blender renders, as arrays, and how near two are."""

from pathlib import Path

import bpy
import numpy as np

EEVEE = "BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT"


def picture(scene: bpy.types.Scene, engine: str, folder: Path) -> np.ndarray:
    """[H, W, 3] as Blender writes it in floats, rows from the top."""
    return with_alpha(scene, engine, folder)[..., :3]


def with_alpha(scene: bpy.types.Scene, engine: str, folder: Path) -> np.ndarray:
    """[H, W, 4] of the same, premultiplied.

    EEVEE is given no lamps by the checks, and its shadows, which nobody sees then, take most of its time.
    """
    scene.render.engine = engine
    if engine == EEVEE:
        scene.eevee.use_shadows = False
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGBA"
    scene.render.filepath = str(folder / "out.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    image.alpha_mode = "PREMUL"
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)[::-1]


def rendered(scene: bpy.types.Scene, engine: str, folder: Path) -> np.ndarray:
    """The same within 0 and 1, as pictures of the package are."""
    return picture(scene, engine, folder).clip(0, 1)


def as_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear values from 0 on as sRGB ones."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """In decibels, of pictures whose white is 1."""
    return -10 * np.log10(np.mean((a - b) ** 2))
