"""The pictures of docs/dogpath.md, and the environment map that its first scene is lit by.

    python -m scripts.pictures.light [studio] [truth] [interior] [shade] [smooth]

``studio`` writes scenes/studio.hdr, the light of scenes/demo_truth.xml as seen from its middle. ``truth`` renders
scenes/still_life_in_the_light.xml with the model, and with the meshes that it was trained from. ``interior`` renders
scenes/still_life_indoors.xml at three exposures, ``shade`` scenes/still_life_in_the_shade.xml without and with shadows
on the model, and with the meshes, ``smooth`` the first scene with few samples, denoised, and with many.
"""

import sys
from typing import Any

import mi_dogsplat  # noqa: F401  before Mitsuba: it chooses the LLVM
import mitsuba as mi
import numpy as np
from mi_dogsplat.render.denoise import denoised
from mi_dogsplat.render.panels import labelled
from mi_dogsplat.support.srgb import linear_to_srgb

from benchmarks.tracing.lit_scenes import INDOORS, LIGHT, SCENES, SHADE, for_denoiser, loaded, of_meshes, picture

from .panels import write_rows

WIDTH, HEIGHT, SPP = 360, 270, 48  # of a panel
STUDIO = (128, 256)  # pixels of the environment map


def studio() -> None:
    """A grey surrounding with a warm window, where the lamp of demo_truth.xml is seen from the middle of the table."""
    height, width = STUDIO
    v, u = (np.mgrid[0:height, 0:width] + 0.5) / np.reshape(STUDIO, (2, 1, 1))
    θ, φ = np.pi * v, 2 * np.pi * u
    local = np.stack([np.sin(φ) * np.sin(θ), np.cos(θ), -np.cos(φ) * np.sin(θ)], -1)  # as Mitsuba maps it, y up
    world = np.stack([local[..., 0], -local[..., 2], local[..., 1]], -1)  # the scene turns it to z up
    origin = np.array([-9.0, -8, 14])
    axis = origin / np.linalg.norm(origin)
    right = np.cross([0, 0, 1], axis)
    right /= np.linalg.norm(right)
    along, tangent = world @ axis, 3 / np.linalg.norm(origin)
    across = np.maximum(np.abs(world @ right), np.abs(world @ np.cross(axis, right)))
    window = (along > 0) & (across < tangent * along)
    angle = (np.sin(θ) * np.pi / height * 2 * np.pi / width)[window].sum()
    exact = 4 * np.arctan(tangent**2 / np.sqrt(1 + 2 * tangent**2))  # of a square pyramid
    image = np.where(window[..., None], np.array([18.5, 16.4, 13.6]) * exact / angle, [0.61, 0.64, 0.68])
    mi.Bitmap(image.astype(np.float32)).write(str(SCENES / "studio.hdr"))


def shown(linear: np.ndarray, stops: float = 0.0) -> np.ndarray:
    return np.clip(linear_to_srgb(linear * 2.0**stops), 0, 1)


def truth() -> None:
    """Write docs/pictures/dogpath.png."""
    scene, size = loaded(LIGHT), (WIDTH, HEIGHT)
    splatted: Any = mi.load_dict({"type": "dogsplat", "surfaces": {"type": "path", "max_depth": 8}})
    panels = [(picture(scene, SPP, size, integrator=splatted), "dogsplat: neither shadows nor mirror images"),
              (picture(scene, SPP, size), f"dogpath, {SPP} samples per pixel"),
              (picture(of_meshes(LIGHT), 4 * SPP, size), "the meshes that the model was trained from")]
    write_rows("dogpath.png", [[labelled(shown(image), text) for image, text in panels]])


def interior() -> None:
    """Write docs/pictures/dogpath_indoors.png."""
    image = picture(loaded(INDOORS), SPP, (WIDTH, HEIGHT))
    texts = {0: "as it is", -4: "4 stops darker: the lamp keeps its shape", 2: "2 stops brighter"}
    write_rows("dogpath_indoors.png", [[labelled(shown(image, stops), text) for stops, text in texts.items()]])


def shade() -> None:
    """Write docs/pictures/dogpath_shade.png."""
    scene, size = loaded(SHADE), (WIDTH, HEIGHT)
    panels = []
    for shadows, text in ((False, "the model keeps its light"), (True, "mesh_shadows: the board takes some")):
        scene.integrator().mesh_shadows = shadows
        panels.append((picture(scene, SPP, size), text))
    panels.append((picture(of_meshes(SHADE), 4 * SPP, size), "the meshes that the model was trained from"))
    write_rows("dogpath_shade.png", [[labelled(shown(image), text) for image, text in panels]])


def smooth() -> None:
    """Write docs/pictures/dogpath_denoised.png."""
    scene, size, few = loaded(LIGHT), (WIDTH, HEIGHT), 8
    panels = [(picture(scene, few, size), f"{few} samples per pixel"),
              (denoised(*for_denoiser(scene, few, size)), "the same, denoised"),
              (picture(scene, 1024, size), "1,024 samples")]
    write_rows("dogpath_denoised.png", [[labelled(shown(image), text) for image, text in panels]])


PARTS = {"studio": studio, "truth": truth, "interior": interior, "shade": shade, "smooth": smooth}


if __name__ == "__main__":
    mi.set_variant("llvm_ad_rgb")
    for part in sys.argv[1:] or PARTS:
        PARTS[part]()
