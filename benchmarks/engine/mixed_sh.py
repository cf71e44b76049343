"""What a model costs whose primitives have SH degrees of their own, beside degree 3 and degree 0 for all.

Two mixed models, in random order: a third of the primitives each has degree 0, 1 and 3; a tenth has degree 3, the rest
degree 0. All are the same primitives; what they are compared in is the time of all processors, in turns.
"""

from __future__ import annotations

import argparse
import time

import drjit as dr
import numpy as np
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.train import Trainer

from ..processors.launches import trainer_of
from ..timing import ratio
from .trainer_passes import passes

PAIRS = 40  # of calls; a training step among them must not densify, which it does after 99
MIXTURES = {"a third each 0, 1, 3": (0, 1, 3), "a tenth 3": (3, *[0] * 9)}
UNIFORM = {"degree 3": 3, "degree 0": 0}


def trainers(n: int, width: int, height: int) -> dict[str, Trainer]:
    """The models in a training, all degrees in use."""
    rng = np.random.default_rng(0)
    degrees = {name: rng.permutation(np.resize(chosen, n)) for name, chosen in MIXTURES.items()}
    made = {name: trainer_of(n, width, height, dog=False) for name in (*degrees, *UNIFORM)}
    for name, trainer in made.items():
        trainer.optimizer.set_sh_degrees(degrees.get(name, np.full(n, UNIFORM.get(name, 0))))
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
    set_variant(args.variant)
    print("| primitives | degrees | floats each | pass | ms | over degree 3 | over degree 0 |\n" + "|---" * 7 + "|")
    for n in args.primitives:
        for name in MIXTURES:
            made = trainers(n, *args.size)
            runs = {of: passes(trainer) for of, trainer in made.items()}
            held = [f"{floats(made[of]):.1f}" for of in (name, *UNIFORM)]
            for kind, run in runs[name].items():
                found = [ratio(run, runs[of][kind], PAIRS, time.process_time) for of in UNIFORM]
                over = " | ".join(f"{r.median:.2f} ({r.low:.2f} to {r.high:.2f})" for r in found)
                print(f"| {n:,} | {name} | {' / '.join(held)} | {kind} | {found[0].a_ms:.1f} | {over} |", flush=True)
