"""What a comparison consists of: tasks that need nothing but a folder, each done in a process of its own.

start   densify, once per data set and seed
train   a method, from that start
time    the renders of all models of a data set and seed, in turns
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..ablation.variants import densified_start, draw_in_turn, is_complete, train_variant
from ..datasets import load_dataset
from ..errors import DataError
from ..files import write_json
from ..pruning.scheduler import target_count
from ..training.checkpoint import load_checkpoint
from ..training.config import TrainConfig
from .methods import METHODS
from .perceptual import LPIPS, lpips_of_run


@dataclass(frozen=True)
class Task:
    """Something to do in the folder of a data set, whose ``config.json`` has the settings."""

    kind: str  # start, train or time
    folder: str  # of the data set within the comparison
    seed: int
    methods: tuple[str, ...] = ()  # the one to train, or all to time

    @property
    def name(self) -> str:
        """For people, and unique."""
        what = {"start": "densified start", "time": "render times"}.get(self.kind) or self.methods[0]
        return f"{Path(self.folder).name}, seed {self.seed}: {what}"

    @property
    def seed_folder(self) -> Path:
        return Path(self.folder) / f"seed_{self.seed}"

    @property
    def log(self) -> Path:
        """What the process says on its error stream; it is kept where the task has failed."""
        return self.seed_folder / f"{self.methods[0] if self.kind == 'train' else self.kind}.log"

    def needs(self, other: Task) -> bool:
        """Whether the other one has to come first; it need not have succeeded."""
        order = ("start", "train", "time")
        same = (self.folder, self.seed) == (other.folder, other.seed)
        return same and order.index(other.kind) < order.index(self.kind)

    @property
    def done(self) -> bool:
        """Whether there is nothing left to do. Times are taken again: they depend on who is there."""
        if self.kind == "start":
            return (self.seed_folder / "start.npz").exists()
        return self.kind == "train" and is_complete(self.seed_folder / self.methods[0], METHODS[self.methods[0]])


def tasks_of(folder: Path, seeds: Sequence[int], methods: Sequence[str]) -> list[Task]:
    """All tasks of a data set, each after those that it needs."""
    where, tasks = str(folder.resolve()), []
    for seed in seeds:
        tasks.append(Task("start", where, seed))
        tasks += [Task("train", where, seed, (name,)) for name in methods]
        tasks.append(Task("time", where, seed, tuple(methods)))
    return tasks


def perform(task: Task, progress: Callable[[str], None] = lambda line: None) -> None:
    """Do it, in this process. Raises whatever goes wrong."""
    settings = json.loads((Path(task.folder) / "config.json").read_text(encoding="utf-8"))
    config = TrainConfig(**settings, preset="3dgs", seed=task.seed)
    dataset = load_dataset(config.data, config.downscale)
    start = task.seed_folder / "start.npz"
    if task.kind == "start":
        densified_start(config, dataset, start, progress)
    elif task.kind == "train":
        if not start.exists():
            raise DataError(start, "there is no densified start", "see start.log beside it, then compare again")
        state, (name,) = load_checkpoint(start), task.methods
        count = target_count(config.target, np.size(state["optimizer.logit_opacities"]))
        run = task.seed_folder / name
        train_variant(replace(config, target=count), METHODS[name], run, state, progress)
        if (distance := lpips_of_run(run, [view.name for view in dataset.test])) is not None:
            write_json(run / LPIPS, {"lpips": distance})
    else:
        complete = [name for name in task.methods if is_complete(task.seed_folder / name, METHODS[name])]
        draw_in_turn(dataset, config, {name: task.seed_folder / name for name in complete})
