"""How to start 3D-DoG: the same pruned model is trained on with each start, and the table tells what came of it.

``python -m benchmarks dog_start --scene fox --seeds 0 1 2``; minutes to hours. A run up to the activation is made
once per scene and seed and kept beside the table, so that all starts, also those of later calls, share it. Rows are
added to the table as they are measured.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_dogsplat.datasets import Dataset, load_dataset
from mi_dogsplat.runs.checkpoint import load_checkpoint, save_checkpoint
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.strategy.dog_control import DogRule
from mi_dogsplat.training.train import Trainer

from ..models import DATA

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
SWEEP_EVERY = 50  # steps between looks at the number of DoG primitives and the clock, as in a run's history


def main(flags: Sequence[str]) -> None:
    args = _arguments(flags)
    mi.set_variant(args.variant)
    args.out.mkdir(parents=True, exist_ok=True)
    table = args.out / "dog_start.md"
    if not table.exists():
        _add_row(table, COLUMNS)
        _add_row(table, ["---"] * len(COLUMNS))
    dataset = load_dataset(str(DATA / args.scene), args.downscale)
    for seed in args.seeds:
        config = TrainConfig(
            str(DATA / args.scene), args.preset, args.steps, target=args.target, downscale=args.downscale,
            max_primitives=args.max_primitives, seed=seed, variant=args.variant,
        )  # fmt: skip
        state = _pruned_state(config, dataset, args.out)
        for name in args.starts:
            _add_row(
                table, [args.scene, str(seed), name, *_continue(config, dataset, state, STARTS[name], args.dog_steps)]
            )


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


def _pruned_state(config: TrainConfig, dataset: Dataset, out: Path) -> dict[str, np.ndarray]:
    """State of a run at the step of the activation, from an earlier call or made now."""
    settings = config.preset, config.steps, config.target, config.downscale, config.max_primitives, config.seed
    path = out / ("_".join([Path(config.data).name, *map(str, settings)]) + ".npz")
    if not path.exists():
        recipe = RECIPES[config.preset]
        trainer = Trainer(config, dataset, replace(recipe, dog=None))
        while trainer.step_count < _activation(config):
            trainer.step()
        save_checkpoint(path, trainer.state())
    return load_checkpoint(path)


def _activation(config: TrainConfig) -> int:
    """Step of the run at which the recipe makes the model DoG."""
    dog = RECIPES[config.preset].scaled(config.steps).dog
    assert dog is not None  # --preset offers no other
    return dog.start


def _continue(
    config: TrainConfig, dataset: Dataset, state: dict[str, np.ndarray], rule: DogRule | None, steps: int | None
) -> list[str]:
    """Train on from a state with a start; the columns of the table from N on."""
    recipe = RECIPES[config.preset]
    at_once = replace(rule, start=recipe.dog.start) if rule and recipe.dog else None
    trainer = Trainer(config, dataset, replace(recipe, dog=at_once))
    trainer.restore(state)
    before = _test_psnr(trainer)
    trainer.begin()  # makes it DoG
    after = _test_psnr(trainer)
    steps = config.steps - trainer.step_count if steps is None else steps

    clock = [(0, time.perf_counter())]
    for step in range(1, steps + 1):
        trainer.step()
        if step % SWEEP_EVERY == 0 or step == steps:
            _ = trainer.optimizer.n_dog
            dr.sync_thread()
            clock.append((step, time.perf_counter()))
    counts, seconds = np.diff(clock, axis=0).T
    milliseconds = 1e3 * np.median(seconds / counts)  # the first kernels and a busy machine do not count

    splats = trainer.optimizer.to_splats()
    median = f"{np.median(splats.dog_scales):.2f}" if splats.n_dog else ""
    measured = f"{before:.2f}", f"{after:.2f}", str(steps), f"{_test_psnr(trainer):.2f}", f"{trainer.training_l1():.5f}"
    return [str(splats.n_splats), *measured, str(splats.n_dog), median, f"{milliseconds:.1f}"]


def _test_psnr(trainer: Trainer) -> float:
    """Mean over the test views."""
    found = trainer.test_psnr()
    assert found is not None  # the scenes have test views
    return found


def _add_row(table: Path, cells: Sequence[str]) -> None:
    row = "| " + " | ".join(cells) + " |"
    print(row, flush=True)
    with open(table, "a", encoding="utf-8") as file:
        file.write(row + "\n")
