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

from typing import Any

import mitsuba as mi
import numpy as np
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.render.denoise import denoised

from .error_table import ErrorTable, display
from .lit_runs import by_primitives, by_samples, contestants, parsed, parser_of
from .lit_scenes import IN_PLACE, LIGHT, MODEL, empty, for_denoiser, loaded, of_meshes, picture
from .regions import regions


def mirrored(size: tuple[int, int]) -> None:
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
        return display(np.array(mi.render(scene, spp=16)))

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
    parser = parser_of("dogpath", __doc__, (320, 240), 2048)
    contestants(parser)
    args = parsed(parser, argv)
    size = args.size
    mirrored(size)
    meshes, model = of_meshes(LIGHT), loaded(LIGHT)
    shown, alone = picture(meshes, args.truth, size), picture(empty(LIGHT), args.truth, size)
    masks = regions(meshes, shown, alone, size)
    splatted: Any = mi.load_dict({"type": "dogsplat", "surfaces": {"type": "path", "max_depth": 8}})
    most, table = max(args.samples), ErrorTable(shown, masks)
    n = read_model(IN_PLACE).splats.n_splats
    by_samples(table, args, model, meshes, n)
    for spp in args.samples[1:-1]:
        table.row("dogpath, denoised", spp, n, lambda seed, spp=spp: denoised(*for_denoiser(model, spp, size, seed)))
    over_white = loaded(LIGHT, MODEL)
    table.row("dogpath, still_life.ply", most, n, lambda seed: picture(over_white, most, size, seed))
    table.row("dogsplat, path nested", most, n, lambda seed: picture(model, most, size, seed, splatted))
    by_primitives(table, args, LIGHT, IN_PLACE)
