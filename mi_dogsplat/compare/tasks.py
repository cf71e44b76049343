"""What a comparison consists of: tasks that need nothing but a folder, each done in a process of its own.

start   densify, once per data set and seed; where that leaves no more primitives than a target asks for, it fails
train   a method, from that start
time    the renders of all models of a data set and seed, in turns
lpips   of all these models, where the weights are installed
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..datasets import load_dataset
from ..datasets.masks import Masks
from ..measure.lpips import Lpips, weights_path
from ..runs.checkpoint import load_checkpoint
from ..support.errors import DataError
from ..training.config import TrainConfig
from ..training.resolve import exposed
from ..training.strategy.scheduler import target_count
from .folders import REMEDY, settings_in
from .method_runs import densified_start, draw_in_turn, is_complete, train_method
from .methods import METHODS
from .names import AT, at_target, method_of
from .perceptual import LPIPS, measure_lpips

KINDS = ("start", "train", "time", "lpips")  # in their order


@dataclass(frozen=True)
class Task:
    """Something to do in the folder of a data set, whose ``config.json`` has the settings."""

    kind: str  # one of KINDS
    folder: str  # of the data set within the comparison
    seed: int
    # the one to train, or those asked for; maybe with a target (``at_target``). Of a start: those that meet one
    methods: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """For people, and unique."""
        what = {"start": "densified start", "time": "render times", "lpips": "LPIPS"}.get(self.kind) or self.methods[0]
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
        same = (self.folder, self.seed) == (other.folder, other.seed)
        return same and KINDS.index(other.kind) < KINDS.index(self.kind)

    def begins_with(self, other: Task) -> bool:
        """Whether it is a run that is nothing without the other one, its start."""
        return self.kind == "train" and other.kind == "start" and self.needs(other)

    @property
    def start(self) -> Path:
        """The checkpoint at the end of densification."""
        return self.seed_folder / "start.npz"

    @property
    def complete(self) -> list[Path]:
        """The run folders that it is about which are there and whole: of its method, or, to measure, of all methods,
        at all targets, those of earlier calls too."""
        names = self.methods
        if self.kind != "train":
            others = sorted(run.name for run in self.seed_folder.glob(f"*{AT}*"))
            names = *METHODS, *(name for name in others if method_of(name) in METHODS)
        runs = {name: self.seed_folder / name for name in names}
        return [run for name, run in runs.items() if is_complete(run, METHODS[method_of(name)])]

    @property
    def done(self) -> bool:
        """Whether there is nothing left to do. Times are taken again: they depend on who is there."""
        if self.kind == "start":
            with suppress(DataError):  # which its process tells
                if self.start.exists():
                    _require_below(self, settings_in(Path(self.folder))["target"])
                    return True
            return False
        if self.kind == "train":
            return bool(self.complete)
        wanted = {self.seed_folder / name for name in self.methods}
        return self.kind == "lpips" and wanted <= {run for run in self.complete if (run / LPIPS).exists()}


def tasks_of(folder: Path, seeds: Sequence[int], methods: Sequence[str], targets: Sequence[float] = ()) -> list[Task]:
    """All tasks of a data set, each once and after those that it needs; ``targets`` beside that of the comparison."""
    where, tasks = str(folder.resolve()), []
    for seed in seeds:
        compact = [name for name in methods if METHODS[name].compact]
        others = tuple(dict.fromkeys(at_target(name, x) for x in targets for name in compact))
        tasks.append(Task("start", where, seed, (*compact, *others)))
        runs = (*methods, *others)
        tasks += [Task("train", where, seed, (name,)) for name in runs]
        tasks.append(Task("time", where, seed, runs))
        if weights_path().exists():
            tasks.append(Task("lpips", where, seed, runs))
    return list(dict.fromkeys(tasks))  # seeds may be given twice, as targets may


def all_tasks(
    folders: Sequence[Path], seeds: Sequence[int], methods: Sequence[str], targets: Sequence[float] = ()
) -> list[Task]:
    """Tasks of several data sets, each after those that it needs. LPIPS comes last: it takes minutes, and no run waits
    for it."""
    tasks = [task for folder in folders for task in tasks_of(folder, seeds, methods, targets)]
    return sorted(tasks, key=lambda task: task.kind == "lpips")


def _require_below(start: Task, target: float) -> None:
    """Raise ``DataError`` unless each target of the runs that are to begin with a start is below its primitives."""
    n = _n_primitives(start.start)
    for name in start.methods:
        _count(name, target, n)


def _count(name: str, target: float, n: int) -> float:
    """Primitives that a run, by its name, is to leave of ``n``. Raises ``DataError``."""
    flag, wanted = ("--more-targets", float(name.partition(AT)[2])) if AT in name else ("--target", target)
    try:
        return target_count(wanted, n)
    except ValueError as error:
        if not METHODS[method_of(name)].compact:
            return wanted  # which no baseline meets
        raise DataError(flag, str(error), "choose another target for the densified start") from None


def _n_primitives(start: Path) -> int:
    """Of a densified start. Raises ``DataError``."""
    try:
        return np.size(load_checkpoint(start)["optimizer.logit_opacities"])
    except KeyError:
        raise DataError(start, "is not a densified start", REMEDY) from None


def perform(task: Task, free: Mapping[str, Any]) -> None:
    """Do it, in this process. Raises whatever goes wrong.

    Args:
        free: settings by name that the folder does not hold, since no result depends on them.
    """
    config = TrainConfig(**settings_in(Path(task.folder)), **free, preset="3dgs", seed=task.seed)
    start = task.start
    if task.kind == "start":
        if not start.exists():
            densified_start(config, start)
        _require_below(task, float(config.target))
    elif task.kind == "train":
        if not start.exists():
            raise DataError(start, "there is no densified start", "see start.log beside it, then compare again")
        (name,) = task.methods
        count = _count(name, float(config.target), _n_primitives(start))
        run = task.seed_folder / name
        if (run / LPIPS).exists():  # of a run with another recipe
            (run / LPIPS).unlink()
        train_method(replace(config, target=count), method_of(name), run, start)
    elif task.kind == "time":
        dataset = exposed(config, load_dataset(config.data, config.downscale, split=config.split))
        draw_in_turn(dataset, config, task.complete)
    elif runs := [run for run in task.complete if not (run / LPIPS).exists()]:
        if not weights_path().exists():
            raise DataError(weights_path(), "the weights of LPIPS are not on this machine", "make lpips there")
        dataset = load_dataset(config.data, config.downscale, split=config.split)
        masks = Masks(config.masks, dataset.views) if config.masks else None
        if lpips := Lpips.installed(view.camera for view in dataset.test):
            measure_lpips(runs, dataset.test, lpips, masks)
