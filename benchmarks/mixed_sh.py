"""What a model costs whose primitives have SH degrees of their own, beside degree 3 and degree 0 for all.

Of the mixed model a third of the primitives each, in random order, has degree 0, 1 and 3. All three are the same
primitives and show nearly the same; what they are compared in is the time of all processors, in turns.
"""

from __future__ import annotations

import argparse
import time

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.training.train import Trainer

from .launches import trainer_of
from .timing import ratio
from .trainer_passes import passes

PAIRS = 40  # of calls; a training step among them must not densify, which it does after 99
MIXED_DEGREES = (0, 1, 3)


def trainers(n: int, width: int, height: int) -> dict[str, Trainer]:
    """The three models in a training, all degrees in use."""
    degrees = {
        "mixed": np.random.default_rng(0).permutation(np.resize(MIXED_DEGREES, n)),
        "degree 3": np.full(n, 3),
        "degree 0": np.zeros(n, int),
    }
    made = {name: trainer_of(n, width, height, dog=False) for name in degrees}
    for name, trainer in made.items():
        trainer.optimizer.set_sh_degrees(degrees[name])
    return made


def floats(trainer: Trainer) -> float:
    """Parameters of a primitive on the device."""
    return sum(dr.width(value) for value in trainer.optimizer.adam.values()) / trainer.optimizer.n


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks mixed_sh", description=__doc__)
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--primitives", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--size", type=int, nargs=2, default=(400, 300), metavar=("W", "H"))
    args = parser.parse_args(arguments)
    mi.set_variant(args.variant)
    print("| primitives | pass | mixed, ms | over degree 3 | over degree 0 |\n|---|---|---|---|---|")
    for n in args.primitives:
        made = trainers(n, *args.size)
        runs = {name: passes(trainer) for name, trainer in made.items()}
        for kind, run in runs["mixed"].items():
            found = [ratio(run, runs[f"degree {k}"][kind], PAIRS, time.process_time) for k in (3, 0)]
            over = [f"{r.median:.2f} ({r.low:.2f} to {r.high:.2f})" for r in found]
            print(f"| {n:,} | {kind} | {found[0].a_ms:.1f} | {over[0]} | {over[1]} |", flush=True)
        held = ", ".join(f"{name} {floats(trainer):.1f}" for name, trainer in made.items())
        print(f"| {n:,} | floats per primitive: {held} | | | |")
