"""The same splats in several renderers, in turns: ``python -m benchmarks renderers``.

``rasterize`` and ``mi.render`` are ours, ``volprim`` is Mitsuba's ``volprim_rf_basic``; gsplat takes part on a GPU
where it is installed. Primitives are spread evenly over the view, plain and of SH degree 3; where ``../shared/data`` is
there, its scenes follow. Backward is to all parameters. Medians of wall time in ms; ratios are over ``rasterize``.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.render.picture import render_picture
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.variants import set_variant

from ..engine.lean import engine_backward, engine_forward
from ..engine.scaling import even_model, front_camera
from ..flags import at_least_one
from ..models import DATA, fern_opaque, fern_points, playbot
from ..timing import medians
from . import gsplat_passes
from .versus_volprim import passes, scenes

OURS = "rasterize"
PASSES = ("forward", "forward + backward")
SLOW = "volprim"  # one call a round is enough
Passes = tuple[Callable[[], None], Callable[[], None]]


def main(flags: Sequence[str]) -> None:
    args = _arguments(flags)
    set_variant(args.variant)
    without = [] if (reason := gsplat_passes.missing()) is None else [f"gsplat is missing: {reason}"]
    rows = []
    for name, (splats, camera) in cases(args):
        contestants: dict[str, Passes] = {OURS: _rasterize(splats, camera)}
        try:
            contestants |= {_name(key): passes(scene) for key, scene in scenes(splats, camera).items()}
        except RuntimeError as error:  # every scene needs OptiX on a GPU
            if "OptiX" not in str(error):
                raise
            without.append("mi.render is not timed: no OptiX")
        difference = None
        if gsplat_passes.missing() is None:
            contestants["gsplat"] = gsplat_passes.passes(splats, camera)
            difference = float(np.abs(gsplat_passes.picture(splats, camera) - _picture(splats, camera)).max())
        for row in measure(contestants, args.rounds):
            rows.append({"splats": name, "primitives": splats.n_splats} | row)
            if difference is not None and row["pass"] == PASSES[0]:
                rows[-1]["largest difference to gsplat"] = difference
            print(rows[-1], flush=True)
        if args.json:
            args.json.write_text(json.dumps(rows), encoding="utf-8")
    print("; ".join(dict.fromkeys([f"{len(rows)} rows", *without])))


def _arguments(flags: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks renderers", description=__doc__)
    parser.add_argument("--primitives", type=int, nargs="*", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--width", type=int, default=800, help="of the view, 4:3")
    parser.add_argument("--rounds", type=at_least_one, default=5)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    return parser.parse_args(flags)


def cases(args: argparse.Namespace) -> list[tuple[str, tuple[Splats, Camera]]]:
    """Names, and models with the view that is rendered; the largest last, for which there may be no time."""
    camera = front_camera(args.width)
    found = [(f"even, {camera.width}x{camera.height}", (even_model(n, camera), camera)) for n in args.primitives]
    if len(args.primitives) > 1 and (DATA / "fern").is_dir():
        found += [("fern's points", fern_points()), ("their opacities random", fern_opaque())]
        found += [("ten times as many", fern_points(10)), ("playbot", playbot())]
    return sorted(found, key=lambda case: case[1][0].n_splats)


def _name(key: str) -> str:
    return "mi.render" if key == "ours" else key


def _rasterize(splats: Splats, camera: Camera) -> Passes:
    degree = splats.sh_degree
    return engine_forward(splats, camera, degree), engine_backward(splats, camera, degree)


def _picture(splats: Splats, camera: Camera) -> np.ndarray:
    return np.asarray(render_picture(upload(splats), camera, RasterOptions(splats.sh_degree)).color)


def measure(contestants: dict[str, Passes], rounds: int) -> list[dict[str, Any]]:
    """A row for each pass: milliseconds of each renderer, and how many times those of ``rasterize`` they are."""
    runs = {f"{name} {PASSES[k]}": pair[k] for name, pair in contestants.items() for k in range(len(PASSES))}
    ms = medians(runs, rounds, {name: 1 for name in runs if name.startswith(SLOW)})
    rows = []
    for label in PASSES:
        row: dict[str, Any] = {"pass": label}
        for name in contestants:
            row[f"{name}, ms"] = ms[f"{name} {label}"]
            if name != OURS:
                row[f"{name}, ratio"] = ms[f"{name} {label}"] / ms[f"{OURS} {label}"]
        rows.append(row)
    dr.flush_malloc_cache()  # the others have allocators of their own
    return rows
