"""``dogpath`` beside the path-traced truth: mean error region by region, against samples, time and primitives.

Before that, without a truth: the image in a plane mirror beside what a camera sees from the mirrored place.

The scene is scenes/still_life_in_the_light.xml. Its truth has the meshes that the model was trained from in place of
the model. Errors are of what a screen shows (sRGB, 0 to 1), absolute, mean over pixels and channels. Regions are those
of the truth: the model itself; the floor where the model takes more than a tenth of its light; the mirror and the
glass where they differ from what they show without the model. ``noise`` is the truth by as many samples. Fewer
primitives are those that ``dogsplat simplify`` merges them to, without a fit. still_life.ply is the same still life,
trained over white from photographs that see nothing from below.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.editing.simplify import simplify_model
from mi_dogsplat.editing.simplify_config import SimplifyConfig
from mi_dogsplat.formats.read import read_model

from .error_table import ErrorTable, display
from .lit_scenes import IN_PLACE, LIGHT, MODEL, empty, loaded, of_meshes, picture

BEYOND = 0.02  # sRGB: less than this is no image in mirror or glass
SHADE = 0.9  # of the light that the floor has without the model
OWN = ("floor", "mirror", "glass", "foot", "board_front", "board_back")  # shapes of the scenes
SHOWING = {"mirror": "mirror image", "glass": "glass", "metal": "metal"}  # shapes in which the model shows


def regions(
    truth: Any, shown: np.ndarray, alone: np.ndarray, size: tuple[int, int], own: tuple[str, ...] = OWN
) -> dict[str, np.ndarray]:
    """Masks [H, W]; ``shown`` and ``alone`` are the truth and the scene without the model, linear.

    ``own``: shapes of the scene; all others of the truth are the model.
    """
    width, height = size
    index = dr.arange(mi.UInt32, width * height)
    x, y = mi.Float(index % width), mi.Float(index // width)
    at: Any = mi.Point2f((x + 0.5) / width, (y + 0.5) / height)
    ray, _ = truth.sensors()[0].sample_ray(0, 0, at, mi.Point2f(0.5))
    met = truth.ray_intersect(ray)
    first = {name: np.zeros((height, width), bool) for name in own}
    for shape in truth.shapes():
        if shape.id() in first:
            mask = met.is_valid() & (met.shape == mi.ShapePtr(shape))
            first[shape.id()] = mask.numpy().reshape(height, width)
    other = met.is_valid().numpy().reshape(height, width) & ~np.logical_or.reduce(list(first.values()))
    differs = np.abs(display(shown) - display(alone)).mean(-1) > BEYOND
    shade = shown.mean(-1) < SHADE * alone.mean(-1)
    images = {name: first[shape] & differs for shape, name in SHOWING.items() if shape in own}
    return {"model": other, "shadow": first["floor"] & shade, **images, "all": np.ones((height, width), bool)}


def mirrored(size: tuple[int, int], spp: int) -> None:
    """Print how far the image in a plane mirror is from what the camera sees from the mirrored place."""
    eye, target = np.array([-1.4, -4.9, 2.75]), np.array([0, -0.05, 0.2])
    axis = (target - eye) / np.linalg.norm(target - eye)
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "pixel_format": "rgb"}
    look_at = mi.ScalarTransform4f().look_at
    rest = {"splats": {"type": "dog", "filename": str(MODEL)}, "sky": {"type": "constant"}}
    mirror = {"type": "rectangle", "bsdf": {"type": "conductor"},
              "to_world": look_at(list(eye + axis), list(eye + 2 * axis), [0, 0, 1]).scale(5)}
    far = {"type": "sphere", "center": list(eye - 100 * axis)}

    def seen(kind: str, to_world: Any, linear: bool, others: dict[str, Any]) -> np.ndarray:
        sensor = {"type": "perspective", "fov": 38, "to_world": to_world, "film": film}
        integrator = {"type": kind, "srgb_primitives": not linear}
        scene: Any = mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor, **rest, **others})
        return display(np.array(mi.render(scene, spp=spp)))

    direct, back = look_at(list(eye), list(target), [0, 0, 1]), look_at(list(eye + 2 * axis), list(eye), [0, 0, 1])
    print("| colours | compared with | mean error | PSNR, dB |")
    print("|---|---|---|---|")
    for linear in (False, True):
        image = seen("dogpath", back, linear, {"mirror": mirror})[:, ::-1]
        for name, kind, others in (("`dogpath`", "dogpath", {"far": far}), ("`dogsplat`", "dogsplat", {})):
            error = image - seen(kind, direct, linear, others)
            decibels = -10 * np.log10((error**2).mean())
            print(f"| {'linear' if linear else 'sRGB'} | {name} | {np.abs(error).mean():.4f} | {decibels:.1f} |")


def main(argv: list[str]) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks dogpath", description=__doc__)
    parser.add_argument("--size", nargs=2, type=int, default=(320, 240), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--samples", nargs="+", type=int, default=[1, 4, 16, 64])
    parser.add_argument("--truth", type=int, default=2048, metavar="SPP")
    parser.add_argument("--primitives", nargs="*", type=int, default=[2500, 1000])
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args(argv)
    mi.set_variant(args.variant)
    size = args.size[0], args.size[1]
    mirrored(size, 16)
    meshes, model = of_meshes(LIGHT), loaded(LIGHT)
    shown, alone = picture(meshes, args.truth, size), picture(empty(LIGHT), args.truth, size)
    masks = regions(meshes, shown, alone, size)
    splatted: Any = mi.load_dict({"type": "dogsplat", "surfaces": {"type": "path", "max_depth": 8}})
    most, row = max(args.samples), ErrorTable(shown, masks).row
    n = read_model(IN_PLACE).splats.n_splats
    for spp in args.samples:
        row("dogpath", spp, n, lambda seed, spp=spp: picture(model, spp, size, seed))
    for spp in args.samples:
        row("noise: path, meshes", spp, 0, lambda seed, spp=spp: picture(meshes, spp, size, seed))
    over_white = loaded(LIGHT, MODEL)
    row("dogpath, still_life.ply", most, n, lambda seed: picture(over_white, most, size, seed))
    row("dogsplat, path nested", most, n, lambda seed: picture(model, most, size, seed, splatted))
    with TemporaryDirectory() as folder:
        for count in args.primitives:
            file = Path(folder) / f"{count}.ply"
            simplify_model(IN_PLACE, file, SimplifyConfig(target=str(count), steps=0))
            fewer = loaded(LIGHT, file)
            row("dogpath", most, count, lambda seed, fewer=fewer: picture(fewer, most, size, seed))
