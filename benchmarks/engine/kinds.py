"""Times of one model made of several kinds of primitives, as a table: what a kind costs beside plain Gaussians.

All primitives have what a row says; DoG are of f_a .05 and F .6. Slopes, normals and the like are random, which costs
what any others do. Colours are the same from all sides. All rows are timed in turns, medians; "x" is the time against
the first. Operations are the compositor's, per primitive and pixel.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from mi_dogsplat.engine.kernel_costs import pair_operations
from mi_dogsplat.engine.options import Settings
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.variants import set_variant

from ..flags import at_least_one
from ..timing import medians
from .dog_share import CASES, load, with_share_of_dog
from .lean import engine_backward, engine_forward

PASSES = ("forward", "forward + backward")
Kind = Callable[[Splats], Splats]


def compare(flags: Sequence[str], name: str, description: str | None, kinds: Mapping[str, Kind]) -> None:
    """Print the table of the experiment ``name``; ``kinds`` make the models of its rows, each of the plain one."""
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks {name}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--model", type=Path, help="a trained model; default: the points of fern")
    parser.add_argument("--scene", default="fern", choices=("fox", "fern", "lego"), help="whose first test view it is")
    parser.add_argument("--downscale", type=int, default=2)
    parser.add_argument("--rounds", type=at_least_one, default=15)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args(flags)
    set_variant(args.variant)
    model, camera = load(args)
    plain = model.plain().without_slopes().without_cuts().without_shifts()  # and without curvatures and second cuts
    models = {kind: make(plain) for kind, make in kinds.items()}
    runs: dict[str, Callable[[], None]] = {}
    for kind, splats in models.items():
        runs[f"{kind}: {PASSES[0]}"] = engine_forward(splats, camera)
        runs[f"{kind}: {PASSES[1]}"] = engine_backward(splats, camera)
    ms, first = medians(runs, args.rounds, dict.fromkeys(runs, 2)), next(iter(models))
    print(f"\n{plain.n_splats:,} primitives, {camera.width}x{camera.height}\n")
    print("| | " + " | ".join(f"{each}, ms | x" for each in PASSES) + " | operations, forward | backward |")
    print("|---" * (3 + 2 * len(PASSES)) + "|")
    for kind, splats in models.items():
        cells = [kind]
        for each in PASSES:
            time = ms[f"{kind}: {each}"]
            cells += [f"{time:.2f}", f"{time / ms[f'{first}: {each}']:.3f}"]
        planes = (splats.n_cuts > 0) + (splats.n_second_cuts > 0)
        settings = Settings(3, slopes=splats.n_slopes > 0, curvatures=splats.n_curvatures > 0, cuts=planes)
        operations = pair_operations(settings, splats.n_dog > 0, args.variant)
        print("| " + " | ".join([*cells, *(f"{count:.1f}" for count in operations)]) + " |")


def as_it_is(splats: Splats) -> Splats:
    """All primitives plain."""
    return splats


def dog(splats: Splats) -> Splats:
    """All primitives DoG."""
    return with_share_of_dog(splats, *CASES["f_a .05, F .6"], share=1.0)


def with_slopes(splats: Splats) -> Splats:
    """All primitives with slopes of the size that training ends with."""
    n = splats.n_splats
    slopes = np.random.default_rng(0).normal(0, 0.1, (n, 3, 3))
    return replace(splats, slope_index=np.arange(n), color_slopes=slopes)


def with_curvatures(splats: Splats) -> Splats:
    """All primitives with a brightness that curves, as much as training ends with."""
    n = splats.n_splats
    curvatures = np.random.default_rng(2).normal(0, 0.1, (n, 6))
    return replace(splats, curvature_index=np.arange(n), brightness_curvatures=curvatures)


def with_cuts(splats: Splats) -> Splats:
    """All primitives cut off, some two standard deviations from their centres."""
    n = splats.n_splats
    return replace(splats, cut_index=np.arange(n), cut_normals=np.random.default_rng(1).normal(0, 1, (n, 3)))


def with_two_cuts(splats: Splats) -> Splats:
    """The same by two planes each."""
    n, cut = splats.n_splats, with_cuts(splats)
    normals = np.random.default_rng(3).normal(0, 1, (n, 3))
    return replace(cut, second_cut_index=np.arange(n), second_cut_normals=normals)


def with_shifts(splats: Splats) -> Splats:
    """All primitives at places that depend on the view, some half a standard deviation from their mean ones."""
    n, rng = splats.n_splats, np.random.default_rng(4)
    shifts, views = rng.normal(0, 0.5, (n, 3, 3)), rng.uniform(-0.5, 0.5, (n, 3))
    return replace(splats, shift_index=np.arange(n), view_shifts=shifts, mean_views=views)
