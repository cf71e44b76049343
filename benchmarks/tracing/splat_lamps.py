"""Noise of the light of splats in ``dogpath``, with and without sampling the directions of captured lamps.

The scenes are scenes/still_life_indoors.xml, which has no such lamp, and the same with one bright splat in place of its
model, its luminous sphere and its window. "variance" is that of a pixel over seeds, "noise" its square root over the
pixel's mean; "dark" has splats without light on all segments but the first: no sampling of them could leave less noise.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import numpy as np
from mi_dogsplat.scene.ply import write_ply
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.srgb import linear_to_srgb
from mi_dogsplat.support.variants import set_variant

from .lit_scenes import INDOORS, loaded, picture, with_lamp

CENTER, RADIANCE, SCALE, LOGIT_OPACITY = (-1.9, 1.6, 1.7), (34.0, 24.0, 14.0), 0.15, 4.6


def lamp() -> Splats:
    """One bright and round primitive of sRGB colours."""
    color = (linear_to_srgb(np.array(RADIANCE)) - 0.5) / C0
    return Splats(np.array([CENTER]), np.full((1, 3), np.log(SCALE)), np.array([[0.0, 0, 0, 1]]),
                  np.array([LOGIT_OPACITY]), color[None, None])


def main(argv: list[str]) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks splat_lamps", description=__doc__)
    parser.add_argument("--size", nargs=2, type=int, default=(120, 90), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--spp", type=int, default=4)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args(argv)
    set_variant(args.variant)
    from mi_dogsplat.plugin import direct_light, dogpath, light_paths  # classes of the variant

    sought, emitted = dogpath.lamps_of, light_paths.emitted

    def row(make: Callable[[], Any], name: str, how: str, lamps: Callable, light: Callable) -> None:
        dogpath.lamps_of, light_paths.emitted, direct_light.emitted = lamps, light, light
        scene = make()  # an integrator of its own, which knows nothing from before
        size = args.size[0], args.size[1]
        picture(scene, args.spp, size, args.seeds)  # compiles
        start = time.process_time()
        images = np.stack([picture(scene, args.spp, size, seed) for seed in range(args.seeds)]).mean(-1)
        seconds = (time.process_time() - start) / args.seeds
        variance, mean = images.var(0, ddof=1), np.maximum(images.mean(0), 1e-3)
        noise = np.median(np.sqrt(variance) / mean)
        numbers = f"{mean.mean():.4f} | {variance.mean():.3e} | {noise:.3f} | {seconds:.2f}"
        print(f"| {name} | {how} | {numbers} |", flush=True)
        dogpath.lamps_of, light_paths.emitted, direct_light.emitted = sought, emitted, emitted

    def nothing(params: dict, linear: bool) -> None:
        return None

    def dark(colors: list, T: Any, linear: bool) -> list:
        return [c * 0 for c in emitted(colors, T, linear)]

    print("| scene | splats on paths | mean | variance | noise, median | processor seconds |")
    print("|---|---|---|---|---|---|")
    with TemporaryDirectory() as folder:
        file = Path(folder) / "lamp.ply"
        write_ply(file, lamp())
        shape = ElementTree.fromstring('<shape type="dog"><string name="filename"/></shape>')
        shape[0].set("value", str(file))
        scenes = {"indoors": lambda: loaded(INDOORS), "captured lamp": lambda: with_lamp(INDOORS, shape)}
        for name, make in scenes.items():
            row(make, name, "BSDF sampling", nothing, emitted)
            row(make, name, "lamps sampled too", sought, emitted)
            row(make, name, "dark", nothing, dark)
