"""One pruned model, trained on in several ways: its state, its steps and the table of what came of them."""

from __future__ import annotations

import time
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import drjit as dr
import numpy as np
from mi_dogsplat.datasets import Dataset
from mi_dogsplat.runs.checkpoint import load_checkpoint, save_checkpoint
from mi_dogsplat.training.config import TrainConfig
from mi_dogsplat.training.given_rows import GIVEN
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.train import Trainer

LOOK_EVERY = 50  # steps between looks at the number of DoG primitives and the clock, as in a run's history


def pruned_state(config: TrainConfig, dataset: Dataset, out: Path) -> dict[str, np.ndarray]:
    """State of a run at the step at which its recipe makes the model DoG, from an earlier call or made now."""
    settings = config.preset, config.steps, config.target, config.downscale, config.max_primitives, config.seed
    place = Path(config.data).resolve()  # two captures may have one name
    capture = f"{place.name}_{zlib.crc32(str(place).encode()):08x}"
    split = [] if config.split == "test" else [config.split]
    path = out / ("_".join([capture, *map(str, settings), *split]) + ".npz")
    if not path.exists():
        recipe = RECIPES[config.preset]
        trainer = Trainer(config, dataset, replace(recipe, dog=None, **dict.fromkeys(GIVEN)))
        while trainer.step_count < _activation(config):
            trainer.step()
        save_checkpoint(path, trainer.state())
    return load_checkpoint(path)


def train_on(trainer: Trainer, steps: int) -> float:
    """Take that many steps; median time of one in ms, without measurements."""
    clock = [(0, time.perf_counter())]
    for step in range(1, steps + 1):
        trainer.step()
        if step % LOOK_EVERY == 0 or step == steps:
            _ = trainer.optimizer.n_dog
            dr.sync_thread()
            clock.append((step, time.perf_counter()))
    counts, seconds = np.diff(clock, axis=0).T
    return 1e3 * float(np.median(seconds / counts))  # the first kernels and a busy machine do not count


def measured_psnr(trainer: Trainer) -> float:
    """Mean over the views that are measured."""
    found = trainer.test_psnr()
    assert found is not None  # the scenes have some
    return found


def begin_table(path: Path, columns: Sequence[str]) -> None:
    """A table with a head; one that is there stays."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists():
        add_row(path, columns)
        add_row(path, ["---"] * len(columns))


def add_row(path: Path, cells: Sequence[str]) -> None:
    """Print a row, and add it to the table."""
    row = "| " + " | ".join(cells) + " |"
    print(row, flush=True)
    with open(path, "a", encoding="utf-8") as file:
        file.write(row + "\n")


def _activation(config: TrainConfig) -> int:
    dog = RECIPES[config.preset].scaled(config.steps).dog
    assert dog is not None  # --preset offers no other
    return dog.start
