"""How much the noise of a film of ``dogpath`` flickers, where its frames have the same random numbers, and their own.

Scenes: scenes/still_life_in_the_light.xml and scenes/still_life_indoors.xml, seen by a camera that goes around the
vertical through the origin. Errors are of what a screen shows (sRGB, 0 to 1), against the scene itself with many
samples: "error" is their root mean square, "flicker" that of the difference between two frames in turn, over √2. So it
is the error itself where those of two frames have nothing in common, and less where they are alike.
"""

from __future__ import annotations

import argparse
import itertools
from typing import Any

import mitsuba as mi
import numpy as np
from mi_dogsplat.render.denoise import denoised

from .error_table import display
from .lit_runs import parsed, parser_of
from .lit_scenes import INDOORS, LIGHT, for_denoiser, loaded, picture

OF_TRUTH = 999  # seed, which no frame has


def main(argv: list[str]) -> None:
    """Print a table for each scene and pace."""
    parser = parser_of("flicker", __doc__, (160, 120), 256)
    parser.add_argument("--samples", nargs="+", type=int, default=[4, 16])
    parser.add_argument("--degrees", nargs="+", type=float, default=[0.25, 1.0], help="from frame to frame")
    parser.add_argument("--frames", type=int, default=6)
    args = parsed(parser, argv)
    for name, path in {"in the light": LIGHT, "indoors": INDOORS}.items():
        for degrees in args.degrees:
            _table(name, loaded(path), degrees, args)


def _table(name: str, scene: Any, degrees: float, args: argparse.Namespace) -> None:
    sensor: Any = mi.traverse(scene.sensors()[0])
    first, around = sensor["to_world"], mi.Transform4f().rotate

    def seen(frame: int) -> Any:
        """The scene from where the camera stands in a frame."""
        sensor["to_world"] = around(axis=[0, 0, 1], angle=degrees * frame) @ first
        sensor.update()
        return scene

    numbers = range(args.frames)
    truth = [display(picture(seen(frame), args.truth, args.size, OF_TRUTH)) for frame in numbers]
    print(f"| {name}, {degrees:g} degrees | numbers | error, flicker | denoised: error, flicker |")
    print("|---|---|---|---|")
    for spp, same in itertools.product(args.samples, (False, True)):
        renders = [for_denoiser(seen(frame), spp, args.size, 0 if same else frame) for frame in numbers]
        noisy = [display(image[..., :3]) for image, _ in renders]
        smooth = [display(denoised(image, names)[..., :3]) for image, names in renders]
        cells = " | ".join("{:.4f}, {:.4f}".format(*_errors(frames, truth)) for frames in (noisy, smooth))
        print(f"| {spp} samples | {'the same' if same else 'their own'} | {cells} |", flush=True)


def _errors(frames: list[np.ndarray], truth: list[np.ndarray]) -> tuple[float, float]:
    """(error, flicker) of frames [H, W, 3]."""
    errors = np.array([frame - true for frame, true in zip(frames, truth, strict=True)])  # [F, H, W, 3]
    changes = np.diff(errors, axis=0)
    return float(np.sqrt(np.mean(errors**2))), float(np.sqrt(np.mean(changes**2) / 2))
