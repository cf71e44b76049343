"""How much noise Open Image Denoise takes from pictures of ``dogpath``, and what it costs to give it more or less.

Scenes: scenes/still_life_in_the_light.xml, the same with a patterned floor, and scenes/still_life_indoors.xml. Errors
are of what a screen shows (sRGB, 0 to 1), against the scene itself with many samples. "paths" is what light paths
bring, without the splats in front of the camera, "guides" are albedo and normal. The last row is ``denoised``.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.render.denoise import denoised

from .error_table import display
from .lit_runs import parsed, parser_of
from .lit_scenes import INDOORS, LIGHT, for_denoiser, loaded, picture, with_pattern


def main(argv: list[str]) -> None:
    """Print the tables."""
    parser = parser_of("denoising", __doc__, (240, 180), 2048)
    parser.add_argument("--samples", nargs="+", type=int, default=[4, 16, 64])
    args = parsed(parser, argv)
    scenes = {
        "in the light": lambda: loaded(LIGHT),
        "with a patterned floor": lambda: with_pattern(LIGHT, "floor"),
        "indoors": lambda: loaded(INDOORS),
    }
    for name, make in scenes.items():
        _table(name, make(), args)


def _table(name: str, scene: Any, args: argparse.Namespace) -> None:
    truth = display(picture(scene, args.truth, args.size, seed=1))
    ways: dict[str, list[str]] = {}
    for spp in args.samples:
        for way, image in _pictures(scene, spp, args.size).items():
            seen = display(image)
            ways.setdefault(way, []).append(f"{psnr(seen, truth):.1f} dB, {np.abs(seen - truth).mean():.4f}")
    print(f"| {name} | {' | '.join(f'{spp} samples' for spp in args.samples)} |")
    print("|---" * (1 + len(args.samples)) + "|")
    for way, cells in ways.items():
        print(f"| {way} | {' | '.join(cells)} |", flush=True)


def _pictures(scene: Any, spp: int, size: tuple[int, int]) -> dict[str, np.ndarray]:
    """[H, W, 3] of one render, smoothed in several ways."""
    import mitsuba_oidn as oidn

    image, names = for_denoiser(scene, spp, size)
    whole, paths, albedo, normal = (np.ascontiguousarray(image[..., k : k + 3]) for k in (0, 3, 6, 9))
    return {
        "as it is": whole,
        "whole": oidn.denoise(whole, hdr=True),
        "whole, with guides": oidn.denoise(whole, albedo, normal, hdr=True),
        "paths": whole - paths + oidn.denoise(paths, hdr=True),
        "paths, with guides": whole - paths + oidn.denoise(paths, albedo, normal, hdr=True),
        "**paths, with guides that are smoothed first**": denoised(image, names),
    }
