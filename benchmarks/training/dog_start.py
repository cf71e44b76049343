"""How to start 3D-DoG: the same pruned model is trained on with each start, and the table tells what came of it.

``python -m benchmarks dog_start --scene fox --seeds 0 1 2``; minutes to hours. A run up to the activation is made
once per scene and seed and kept beside the table, so that all starts, also those of later calls, share it. Rows are
added to the table as they are measured.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.support.variants import set_variant
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.dog_control import DogRule
from mi_dogsplat.training.train import Trainer

from ..models import DATA
from .activation import add_row, begin_table, measured_psnr, pruned_state, train_on

SMALL = DogRule(opacity=0.05)
STARTS: dict[str, DogRule | None] = {
    "none": None,
    "released: f_a .5, F 1.6": DogRule(),
    "f_a .5, F .6": DogRule(scale=0.6),
    "f_a .05, F 1.6": replace(SMALL, scale=1.6),
    "f_a .05, F 1": replace(SMALL, scale=1.0),
    "f_a .05, F .6": replace(SMALL, scale=0.6),
    "f_a .05, F 1.6 and .6 in turn": replace(SMALL, scale=(1.6, 0.6)),
    "f_a .02, F .6": DogRule(opacity=0.02, scale=0.6),
    "f_a .05, F .6, no control": replace(SMALL, scale=0.6, control=False),
}
COLUMNS = (
    "scene", "seed", "start", "N", "before", "just after", "steps", "dB", "train L1", "DoG left", "median F", "ms/step",
)  # fmt: skip


def main(flags: Sequence[str]) -> None:
    args = _arguments(flags)
    set_variant(args.variant)
    table = args.out / "dog_start.md"
    begin_table(table, COLUMNS)
    dataset = load_dataset(str(DATA / args.scene), args.downscale)
    for seed in args.seeds:
        config = TrainConfig(
            str(DATA / args.scene), args.preset, args.steps, target=args.target, downscale=args.downscale,
            max_primitives=args.max_primitives, seed=seed, variant=args.variant,
        )  # fmt: skip
        state = pruned_state(config, dataset, args.out)
        for name in args.starts:
            row = _continue(config, dataset, state, STARTS[name], args.dog_steps)
            add_row(table, [args.scene, str(seed), name, *row])


def _arguments(flags: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks dog_start", description=__doc__)
    parser.add_argument("--scene", default="fox", choices=("fox", "fern", "lego"))
    parser.add_argument("--downscale", type=int, default=2)
    parser.add_argument("--steps", type=int, default=7000, help="of the whole run, which the schedule is scaled to")
    parser.add_argument("--dog-steps", type=int, help="from the activation on (default: to the end of the run)")
    with_dog = [name for name in RECIPES if RECIPES[name].dog]
    parser.add_argument("--preset", default="ours", choices=with_dog, help="recipe up to the activation")
    parser.add_argument("--target", type=float, default=0.1)
    parser.add_argument("--max-primitives", type=int, default=40_000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--starts", nargs="+", default=list(STARTS), choices=list(STARTS), metavar="NAME",
                        help="some of: " + "; ".join(STARTS))  # fmt: skip
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--out", type=Path, default=Path("runs/dog_start"))
    return parser.parse_args(flags)


def _continue(
    config: TrainConfig, dataset: Dataset, state: dict[str, np.ndarray], rule: DogRule | None, steps: int | None
) -> list[str]:
    """Train on from a state with a start; the columns of the table from N on."""
    recipe = RECIPES[config.preset]
    at_once = replace(rule, start=recipe.dog.start) if rule and recipe.dog else None
    trainer = Trainer(config, dataset, replace(recipe, dog=at_once))
    trainer.restore(state)
    before = measured_psnr(trainer)
    trainer.begin()  # makes it DoG
    after = measured_psnr(trainer)
    steps = config.steps - trainer.step_count if steps is None else steps
    milliseconds = train_on(trainer, steps)
    splats = trainer.optimizer.to_splats()
    median = f"{np.median(splats.dog_scales):.2f}" if splats.n_dog else ""
    reached = f"{measured_psnr(trainer):.2f}", f"{trainer.training_l1():.5f}"
    measured = f"{before:.2f}", f"{after:.2f}", str(steps), *reached
    return [str(splats.n_splats), *measured, str(splats.n_dog), median, f"{milliseconds:.1f}"]
