"""Pictures that an engine of Blender renders, as arrays, and how near two are."""

from pathlib import Path

import bpy
import numpy as np

EEVEE = "BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT"


def choose_engine(scene: bpy.types.Scene, engine: str) -> None:
    """The engine is that one; EEVEE without what takes most of its time and nobody sees in the checks.

    These give it no lamps, so it needs no shadows. And what light comes from the world it keeps in a map of 2048 x 2048
    pixels, of which a processor makes one in two seconds; without a world it is as large, so there is a black one.
    """
    scene.render.engine = engine
    if engine == EEVEE:
        scene.eevee.use_shadows = False
        if scene.world is None:
            scene.world = bpy.data.worlds.new("Black")
            scene.world.color = (0, 0, 0)
            if scene.world.node_tree is not None:
                scene.world.node_tree.nodes.clear()
        scene.world.probe_resolution = "128"


def picture(scene: bpy.types.Scene, engine: str, folder: Path) -> np.ndarray:
    """[H, W, 3] as Blender writes it in floats, rows from the top."""
    return with_alpha(scene, engine, folder)[..., :3]


def with_alpha(scene: bpy.types.Scene, engine: str, folder: Path) -> np.ndarray:
    """[H, W, 4] of the same, premultiplied."""
    choose_engine(scene, engine)
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


def of_fine_pixels(scene: bpy.types.Scene, engine: str, folder: Path, fine: int = 4) -> np.ndarray:
    """[H, W, 4] of ``with_alpha``, each pixel the mean of ``fine`` by ``fine`` with so many fewer samples each.

    Ours draws the samples of all pixels one after the other, and of small pictures each takes nearly as long.
    """
    render, both = scene.render, (scene.cycles, scene.dogsplat)
    before = [settings.samples for settings in both]
    try:
        render.resolution_percentage = 100 * fine
        for settings in both:
            settings.samples //= fine**2
        seen = with_alpha(scene, engine, folder)
    finally:
        render.resolution_percentage = 100
        for settings, samples in zip(both, before, strict=True):
            settings.samples = samples
    height, width = seen.shape[0] // fine, seen.shape[1] // fine
    return seen.reshape(height, fine, width, fine, 4).mean((1, 3))


def rendered(scene: bpy.types.Scene, engine: str, folder: Path) -> np.ndarray:
    """The same within 0 and 1, as pictures of the package are."""
    return picture(scene, engine, folder).clip(0, 1)


def as_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear values from 0 on as sRGB ones."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """In decibels, of pictures whose white is 1."""
    return -10 * np.log10(np.mean((a - b) ** 2))
