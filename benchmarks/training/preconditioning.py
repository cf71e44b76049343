"""Preconditioned steps: one pruned model, trained on with each rule, measured on validation views.

    python -m benchmarks preconditioning DATA [--downscale K] [--max-primitives N] [--gains 1 1.5] [--dampings 1 inf] …

There is a row for Adam, and one for each gain, damping, memory and start. A damping of ``inf`` leaves nothing of the
matrix: Adam with larger steps. A run up to the activation of DoG is made once per seed and kept beside the table.
With ``--cost`` two trainings of the first seed, with the preset's rule and without, take their steps in turns, and
processor time of a step is all that is measured.
"""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.optimizer.preconditioning import Preconditioning
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.recipe import PRECONDITIONING
from mi_dogsplat.training.train import Trainer

from ..timing import ratio
from .activation import add_row, begin_table, measured_psnr, pruned_state, train_on

COLUMNS = ("seed", "κ", "λ", "memory", "start", "N", "dB", "train L1", "ms/step")
NO_MATRIX = 1e6  # λ: for inf, of which nothing can be taken
WARM_UP = 20  # steps of the rule before its time is taken


def main(flags: Sequence[str]) -> None:
    args = _arguments(flags)
    set_variant(args.variant)
    dataset = load_dataset(args.data, args.downscale, split="validation")
    configs = [
        TrainConfig(
            args.data, "ours", args.steps, downscale=args.downscale, max_primitives=args.max_primitives, seed=seed,
            max_world_scale=math.inf, split="validation", variant=args.variant,
        )
        for seed in args.seeds
    ]  # fmt: skip
    if args.cost:
        _measure_cost(configs[0], dataset, args.preset, args.out)
        return
    table = args.out / "preconditioning.md"
    begin_table(table, COLUMNS)
    for seed, config in zip(args.seeds, configs, strict=True):
        dampings = [min(damping, NO_MATRIX) for damping in args.dampings]
        numbers = itertools.product(args.gains, dampings, args.memories, args.starts)
        for rule in (None, *(Preconditioning(start, *of_steps) for *of_steps, start in numbers)):
            add_row(table, [str(seed), *_words(rule), *_trained(config, dataset, args.preset, rule, args.out)])


def _arguments(flags: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks preconditioning", description=__doc__)
    parser.add_argument("data")
    parser.add_argument("--downscale", type=int, default=4)
    parser.add_argument("--max-primitives", type=int, default=25_000)
    parser.add_argument("--steps", type=int, default=7000, help="of the whole run, which the schedule is scaled to")
    with_dog = [name for name in RECIPES if RECIPES[name].dog]
    parser.add_argument("--preset", default="ours_cuts", choices=with_dog, help="recipe from the activation on")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--gains", type=float, nargs="+", default=[PRECONDITIONING.gain])
    parser.add_argument("--dampings", type=float, nargs="+", default=[PRECONDITIONING.damping])
    parser.add_argument("--memories", type=float, nargs="+", default=[PRECONDITIONING.memory])
    parser.add_argument("--starts", type=int, nargs="+", default=[PRECONDITIONING.start], help="steps of the 30,000")
    parser.add_argument("--cost", action="store_true", help="time of a step with the rule and without")
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--out", type=Path, default=Path("runs/preconditioning"))
    return parser.parse_args(flags)


def _words(rule: Preconditioning | None) -> list[str]:
    if not rule:
        return ["Adam", "", "", ""]
    damping = math.inf if rule.damping == NO_MATRIX else rule.damping
    return [f"{rule.gain:g}", f"{damping:g}", f"{rule.memory:g}", str(rule.start)]


def _trained(
    config: TrainConfig, dataset: Dataset, preset: str, rule: Preconditioning | None, out: Path
) -> list[str]:  # fmt: skip
    """The columns of the table from N on."""
    trainer = _activated(config, dataset, preset, rule, out)
    milliseconds = train_on(trainer, config.steps - trainer.step_count)
    reached = f"{measured_psnr(trainer):.3f}", f"{trainer.training_l1():.5f}"
    return [str(trainer.optimizer.n), *reached, f"{milliseconds:.1f}"]


def _measure_cost(config: TrainConfig, dataset: Dataset, preset: str, out: Path) -> None:
    """Both see the same views, as their seed is one."""
    jointly, alone = (_activated(config, dataset, preset, rule, out) for rule in (PRECONDITIONING, None))
    start = PRECONDITIONING.scaled(config.steps / RECIPES[preset].reference_steps).start + WARM_UP
    for trainer in (jointly, alone):
        train_on(trainer, start - trainer.step_count)
    r = ratio(jointly.step, alone.step, 300, time.process_time)
    print(
        f"{jointly.optimizer.n:,d} primitives: {r.a_ms:.2f} ms of processor time a step with the rule, "
        f"{r.b_ms:.2f} without, {r.median:.3f}x ({r.low:.3f} .. {r.high:.3f})"
    )


def _activated(
    config: TrainConfig, dataset: Dataset, preset: str, rule: Preconditioning | None, out: Path
) -> Trainer:  # fmt: skip
    trainer = Trainer(config, dataset, replace(RECIPES[preset], preconditioning=rule))
    trainer.restore(pruned_state(config, dataset, out))
    trainer.begin()  # makes it DoG
    return trainer
