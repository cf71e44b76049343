"""Packets of 16, 8 and 4 lanes beside each other on one machine: AVX-512, AVX2, and the width of NEON and SSE.

``python -m benchmarks widths``; pin it (``taskset -c 0``) to the cores that are to count. Every contestant is a process
of its own, compiled for its target (``targets.py``); they take turns pass by pass. A contestant is TARGET or
TARGET:BLOCKS, where BLOCKS are the first five fields of ``engine.geometry.Blocks`` separated by commas, instead of the
target's own. "4,4,4,4,4" are tiles of 16 lanes: where packets are narrower their rows need atomics.

Two figures each, medians of the ratio to the first contestant: of the time of the clock, and of processor time, which
other programs on the machine disturb less. All processes are started anew a few times, because a few in a hundred run
a kernel at half to three quarters of its speed for as long as they live. SH degree 0.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.geometry import Blocks
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.mitsuba_cameras import camera_from_mitsuba
from mi_dogsplat.scene.ply import read_ply
from mi_dogsplat.scene.splats import Splats

from ..engine.kinds import Kind, dog, with_curvatures, with_slopes, with_two_cuts
from ..engine.lean import engine_backward, engine_forward
from ..flags import at_least_one
from ..models import fern_points
from .targets import TARGETS, environment

SCENES = Path(__file__).parents[2] / "scenes"
CONTESTANTS = ["own", "avx2:4,4,4,4,4", "avx2", "sse:4,4,4,4,4", "sse"]
WARM_UP = 2  # rounds that compile
PASSES = {"forward": engine_forward, "forward + backward": engine_backward}


def still_life(width: int) -> tuple[Splats, Camera]:
    """The trained model of ``scenes/still_life.xml``, 5,000 primitives."""
    sensor: Any = mi.load_file(str(SCENES / "still_life.xml")).sensors()[0]
    return read_ply(SCENES / "still_life.ply"), camera_from_mitsuba(sensor).resized(width, width * 3 // 4)


def fern_of(make: Kind) -> tuple[Splats, Camera]:
    """Fern's points, all of a kind."""
    splats, camera = fern_points()
    return make(splats), camera


def with_everything(splats: Splats) -> Splats:
    """All primitives as preset ``ours_curvatures`` makes them."""
    return with_two_cuts(with_curvatures(with_slopes(dog(splats))))


MODELS: dict[str, Callable[[], tuple[Splats, Camera]]] = {
    "still life, 400x300": lambda: still_life(400),
    "still life, 800x600": lambda: still_life(800),
    "fern's points, 10,091, 400x300": fern_points,
    "fern's points ten times, 100,910, 400x300": lambda: fern_points(10),
    "fern's points, all DoG": lambda: fern_of(dog),
    "fern's points, DoG with slopes": lambda: fern_of(lambda splats: with_slopes(dog(splats))),
    "fern's points with everything": lambda: fern_of(with_everything),
}


class Contestant:
    """A process that renders when it is told to."""

    def __init__(self, name: str, model: str, folder: Path):
        target, _, blocks = name.partition(":")
        command = sys.executable, "-m", "benchmarks", "widths", "--serve", model, "--blocks", blocks
        self.process: Any = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment(target, folder)
        )

    def ask(self, *words: str) -> Any:
        print(json.dumps(words), file=self.process.stdin, flush=True)
        return json.loads(self.process.stdout.readline())

    def end(self) -> None:
        self.process.stdin.close()
        self.process.wait()


def main(flags: Sequence[str]) -> None:
    args = _arguments(flags)
    if args.serve:
        serve(args.serve, args.blocks)
        return
    for model in args.models:
        print(f"\n## {model}\n\n| | " + " | ".join(f"{p}, ms | time | processor time" for p in PASSES) + " |")
        print("|---" * (1 + 3 * len(PASSES)) + "|", flush=True)
        for name, cells in measure(args.contestants, model, args.starts, args.rounds).items():
            print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def contestant(name: str) -> str:
    """A name as ``--contestants`` takes it."""
    target, _, blocks = name.partition(":")
    if target not in ("own", *TARGETS):
        raise argparse.ArgumentTypeError(f"{target} is none of own, {', '.join(TARGETS)}")
    if blocks and not (len(numbers := blocks.split(",")) == 5 and all(number.isdecimal() for number in numbers)):
        raise argparse.ArgumentTypeError(f"{blocks} are not five numbers with commas")
    return name


def _arguments(flags: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks widths", description=__doc__)
    parser.add_argument("--contestants", nargs="+", type=contestant, default=CONTESTANTS)
    parser.add_argument("--models", nargs="+", default=list(MODELS), choices=list(MODELS))
    parser.add_argument("--starts", type=at_least_one, default=3, help="of all processes")
    parser.add_argument("--rounds", type=at_least_one, default=11, help="after each start")
    parser.add_argument("--serve", choices=list(MODELS), help=argparse.SUPPRESS)  # what a contestant is started with
    parser.add_argument("--blocks", default="", help=argparse.SUPPRESS)
    return parser.parse_args(flags)


def measure(names: Sequence[str], model: str, starts: int, rounds: int) -> dict[str, list[str]]:
    """Cells of a row for each contestant."""
    times = np.concatenate([_one_start(names, model, rounds) for _ in range(starts)], 2)
    ratios = np.median(times / times[0], 2)
    return {
        name: [
            f"{np.median(times[k, p, :, 0]) * 1e3:.1f} | {ratios[k, p, 0]:.2f} | {ratios[k, p, 1]:.2f}"
            for p in range(len(PASSES))
        ]
        for k, name in enumerate(names)
    }


def _one_start(names: Sequence[str], model: str, rounds: int) -> np.ndarray:
    """Seconds, [contestants, passes, rounds, (clock, processor)]."""
    times = np.empty((len(names), len(PASSES), WARM_UP + rounds, 2))
    with tempfile.TemporaryDirectory() as temporary:
        contestants = []
        for k, name in enumerate(names):
            folder = Path(temporary) / str(k)
            folder.mkdir()
            contestants.append(Contestant(name, model, folder))
        for r in range(WARM_UP + rounds):
            for p, key in enumerate(PASSES):
                for k, contestant in enumerate(contestants):
                    times[k, p, r] = contestant.ask(key)
        for contestant in contestants:
            contestant.end()
    return times[:, :, WARM_UP:]


def serve(model: str, blocks: str) -> None:
    """Run a pass for every line of standard input, and answer with its seconds: of the clock, of the processor."""
    mi.set_variant("llvm_ad_rgb")
    if blocks:
        width, height, lanes_x, lanes_y, unroll = map(int, blocks.split(","))
        chosen = Blocks(width, height, lanes_x, lanes_y, unroll)
        Blocks.of_backend = staticmethod(lambda: chosen)
    splats, camera = MODELS[model]()
    plain = replace(splats, sh_coeffs=np.ascontiguousarray(splats.sh_coeffs[:, :1]))
    passes = {name: make(plain, camera) for name, make in PASSES.items()}
    for line in sys.stdin:
        run = passes[json.loads(line)[0]]
        start, used = time.perf_counter(), time.process_time()
        run()
        dr.sync_thread()
        print(json.dumps([time.perf_counter() - start, time.process_time() - used]), flush=True)
