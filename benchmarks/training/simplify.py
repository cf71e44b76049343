"""Fewer primitives without photographs: PSNR against the model itself, beside what another program makes of it.

The cameras are not those of the fit: around the model as ``cameras_around`` places them, and inside with another seed.
Results of another program are files FOLDER/MODEL_PERCENT.ply, as splat-transform writes them:

    npx @playcanvas/splat-transform@2.7.1 -g cpu playbot.ply -F 10% others/playbot_10.ply
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from mi_dogsplat.editing.simplify import cameras_of, fitted, look_of, simplify_model
from mi_dogsplat.editing.simplify_config import SimplifyConfig
from mi_dogsplat.editing.views import weights_in
from mi_dogsplat.export.refine import rendered
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.render.framing import AUTOMATIC_SIZE, cameras_around, likely_up
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.render.vantages import cameras_inside
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.variants import set_variant

VIEWS = 12  # of each kind
SEED = 12345  # of the cameras inside


def quality(truth: Splats) -> Callable[[Splats], list[float]]:
    """What measures a model: mean PSNR in dB from around over black and over grey, and from inside over grey."""
    around = cameras_around(truth, VIEWS)
    inside = cameras_inside(truth, VIEWS, AUTOMATIC_SIZE, np.random.default_rng(SEED), likely_up(truth))
    black, grey = (look_of(truth, PictureOptions(background=name)) for name in ("black", "auto"))
    kinds = [(around, black), (around, grey), (inside, grey)]
    true = [rendered(truth, *kind) for kind in kinds]

    def measured(found: Splats) -> list[float]:
        means = []
        for kind, pictures in zip(kinds, true, strict=True):
            errors = [psnr(a, b) for a, b in zip(rendered(found, *kind), pictures, strict=True)]
            means.append(float(np.mean(errors)))
        return means

    return measured


def main(argv: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks simplify", description=__doc__)
    parser.add_argument("models", nargs="+", type=Path)
    parser.add_argument("--percent", nargs="+", type=float, default=[10, 5, 2])
    parser.add_argument("--steps", type=int, default=SimplifyConfig().steps)
    parser.add_argument("--others", type=Path, metavar="FOLDER", help="results of another program")
    parser.add_argument("--starts", action="store_true", help="also fit the other results, and what weighs most")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args(argv)
    set_variant(args.variant)
    ways = {"merged": (0, False), "fitted": (args.steps, False), "with DoG": (args.steps, True)}
    print("| model | left | how | around, black | around, grey | inside, grey | seconds |")
    print("|---|---|---|---|---|---|---|")
    for model in args.models:
        measured = quality(read_model(model).splats)
        for percent in args.percent:
            others = args.others and args.others / f"{model.stem}_{percent:g}.ply"
            if others and others.exists():
                _row(model, percent, "the other program", measured(read_model(others).splats), None)
            if args.starts:
                _other_starts(model, percent, args.steps, others, measured)
            for how, (steps, dog) in ways.items():
                with TemporaryDirectory() as folder:
                    start, out = time.perf_counter(), Path(folder) / "out.ply"
                    simplify_model(model, out, SimplifyConfig(target=f"{percent:g}%", steps=steps, dog=dog))
                    seconds = time.perf_counter() - start
                    _row(model, percent, how, measured(read_model(out).splats), seconds)


def _other_starts(
    model: Path, percent: float, steps: int, others: Path | None, measured: Callable[[Splats], list[float]]
) -> None:
    """What the same fit makes of the primitives that are seen most, and of what another program has merged."""
    truth, config = read_model(model).splats, SimplifyConfig(target=f"{percent:g}%", steps=steps)
    look = look_of(truth, PictureOptions())
    cameras = cameras_of(truth, config, config.views, config.seed)
    most = np.argsort(-weights_in(truth, cameras, look.drawn).total, kind="stable")[: config.count(truth.n_splats)]
    starts = {"seen most": truth.select(np.sort(most))}
    if others and others.exists():
        starts["the other program"] = read_model(others).splats
    for name, start in starts.items():
        _row(model, percent, name, measured(start), None)
        _row(model, percent, f"{name}, fitted", measured(fitted(start, truth, cameras, look, config)), None)


def _row(model: Path, percent: float, how: str, quality: list[float], seconds: float | None) -> None:
    columns = [f"{value:.2f}" for value in quality] + ["" if seconds is None else f"{seconds:.0f}"]
    print(f"| {model.stem} | {percent:g} % | {how} | " + " | ".join(columns) + " |", flush=True)
