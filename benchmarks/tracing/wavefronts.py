"""Time of a pass of ``dogpath`` against how many rays are traced together: ``python -m benchmarks wavefronts``.

An example scene in several sizes, without and with derivatives by all places of the primitives (reverse mode). All
numbers of rays take turns; medians of wall time in ms, divided by the passes of the render. ``1``: each pass alone.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
from mi_dogsplat.plugin import wavefront
from mi_dogsplat.support.variants import set_variant

from ..flags import at_least_one
from ..timing import medians

SCENES = Path(__file__).parents[2] / "scenes"
NAMES = "still_life_in_the_shade", "still_life_indoors", "still_life_in_the_light"
SIZES = (24, 18), (80, 60), (160, 120), (320, 240)
ON_A_GPU = (80, 60), (320, 240), (800, 600)


def main(argv: Sequence[str]) -> None:
    args = _arguments(argv)
    set_variant(args.variant)
    on_a_gpu = dr.backend_v(mi.Float) is dr.JitBackend.CUDA
    counts = args.rays or [1, *(2**k for k in ((19, 21, 22) if on_a_gpu else (16, 17, 18, 19)))]
    sizes = [(args.width, args.width * 3 // 4)] if args.width else ON_A_GPU if on_a_gpu else SIZES
    rows = []
    for size in sizes:
        scene = mi.load_file(str(SCENES / f"{args.scene}.xml"), resx=size[0], resy=size[1], spp=args.spp)
        for name, run in {"picture": picture, "with derivatives": derived}.items():
            runs = {str(rays): _with_rays(rays, run, scene, args.spp) for rays in counts}
            times = medians(runs, args.rounds, dict.fromkeys(runs, 1))
            rows.append({"size": f"{size[0]}x{size[1]}", "pass": name} | {k: t / args.spp for k, t in times.items()})
            if len(rows) == 1:
                print(f"| {' | '.join(rows[0])} |\n" + "|---" * len(rows[0]) + "|")
            cells = [f"{value:.1f}" if isinstance(value, float) else value for value in rows[-1].values()]
            print(f"| {' | '.join(cells)} |", flush=True)
            if args.json:
                args.json.write_text(json.dumps(rows), encoding="utf-8")


def picture(scene: Any, spp: int) -> None:
    dr.eval(mi.render(scene, spp=spp))


def derived(scene: Any, spp: int) -> None:
    params: Any = mi.traverse(scene)
    means = params["still_life.means"]
    dr.enable_grad(means)
    params.update()
    dr.backward(dr.mean(mi.render(scene, params, spp=spp)))
    dr.eval(dr.grad(means))
    dr.disable_grad(means)


def _with_rays(rays: int, run: Callable[[Any, int], None], scene: Any, spp: int) -> Callable[[], None]:
    def bounded() -> None:
        wavefront.RAYS = rays, rays
        run(scene, spp)

    return bounded


def _arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks wavefronts", description=__doc__)
    parser.add_argument("scene", nargs="?", choices=NAMES, default=NAMES[0], help="of scenes/ (default: %(default)s)")
    most = "that are traced together at most (default: 1 and 2^16 to 2^19, on a GPU to 2^22)"
    parser.add_argument("--rays", type=at_least_one, nargs="+", help=most)
    parser.add_argument("--width", type=at_least_one, help="of the only picture (default: 24 to 320, on a GPU to 800)")
    parser.add_argument("--spp", type=at_least_one, default=16, help="(default: %(default)s)")
    parser.add_argument("--rounds", type=at_least_one, default=3, help="(default: %(default)s)")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    return parser.parse_args(argv)
