"""What colours cost that vary over their primitive: the same model with slopes and without, with DoG and without.

``python -m benchmarks slopes`` on the points of fern as training starts, or ``--model point_cloud.ply --scene fern`` on
a trained model. All primitives have what a row says; DoG are of f_a .05 and F .6. Slopes are random, which costs what
any others do. Colours are the same from all sides. All rows are timed in turns, medians; "x" is the time against the
first. Operations are the compositor's, per primitive and pixel.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.kernel_costs import pair_operations
from mi_dogsplat.engine.options import Settings
from mi_dogsplat.scene.splats import Splats

from ..timing import medians
from .dog_share import CASES, load, with_dog
from .lean import engine_backward, engine_forward

PASSES = ("forward", "forward + backward")
DOG = "f_a .05, F .6"


def main(flags: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks slopes", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--model", type=Path, help="a trained model; default: the points of fern")
    parser.add_argument("--scene", default="fern", choices=("fox", "fern", "lego"), help="whose first test view it is")
    parser.add_argument("--downscale", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args(flags)
    mi.set_variant(args.variant)
    model, camera = load(args)
    plain = model.plain().without_slopes()
    dog = with_dog(plain, *CASES[DOG], share=1.0)
    models = {"plain": plain, "slopes": with_slopes(plain), "DoG": dog, "DoG, slopes": with_slopes(dog)}
    runs: dict[str, Callable[[], None]] = {}
    for name, splats in models.items():
        runs[f"{name}: {PASSES[0]}"] = engine_forward(splats, camera)
        runs[f"{name}: {PASSES[1]}"] = engine_backward(splats, camera)
    ms = medians(runs, args.rounds, dict.fromkeys(runs, 2))
    print(f"\n{plain.n_splats:,} primitives, {camera.width}x{camera.height}\n")
    print("| | " + " | ".join(f"{name}, ms | x" for name in PASSES) + " | operations, forward | backward |")
    print("|---" * (3 + 2 * len(PASSES)) + "|")
    for name, splats in models.items():
        cells = [name]
        for each in PASSES:
            time = ms[f"{name}: {each}"]
            cells += [f"{time:.2f}", f"{time / ms[f'plain: {each}']:.3f}"]
        operations = pair_operations(Settings(3, slopes=splats.n_slopes > 0), splats.n_dog > 0, args.variant)
        print("| " + " | ".join([*cells, *(f"{count:.1f}" for count in operations)]) + " |")


def with_slopes(splats: Splats) -> Splats:
    """All primitives with slopes of the size that training ends with."""
    n = splats.n_splats
    slopes = np.random.default_rng(0).normal(0, 0.1, (n, 3, 3))
    return replace(splats, slope_index=np.arange(n), color_slopes=slopes)
