"""A training run as a folder: config, history, model, test renders, metrics, report."""

from __future__ import annotations

import dataclasses
import errno
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..datasets import Dataset, load_dataset
from ..datasets.depths import without_depth
from ..datasets.masks import without_mask
from ..datasets.refined import require_photographs
from ..datasets.world import World, check_world, metres_of_unit, world_of
from ..poses.config import SETTINGS as POSES
from ..report.run_folder import CONFIG, FIRST, HISTORY, METRICS, POSED, RECIPE
from ..support.arguments import checks_arguments
from ..support.classes import require_class
from ..support.errors import DataError, making, undisguised
from ..support.files import PART, is_empty, json_text, remove_parts, write_json
from ..support.locks import locked
from ..support.variants import require_arrays
from ..training.config import TrainConfig
from ..training.initialize import model_to_prune
from ..training.recipe import Recipe
from ..training.resolve import start_of
from ..training.train import Trainer
from .checkpoint import CHECKPOINT, Checkpoints
from .finish import finish
from .history import run_to_end
from .inputs import PLACES, check_inputs, note_inputs
from .own_recipe import described
from .resume import IN_USE, forget_results, require_no_stopped_run, restore_from, resume_run
from .stopping import Stopped, StopRequest, stopped_with

MEASURING = "stopped after the last step, before all was measured; the same command with --resume measures it"
FORBIDDEN = (errno.EACCES, errno.EPERM, errno.EROFS)  # somebody else's folder, or one that is read-only


def prepare_folder(out: Path) -> None:
    """Make the run folder. Raises ``DataError`` if something else is in its place or it cannot be written."""
    if out.exists() and not out.is_dir():
        raise DataError(out, "is a file", "name a folder for the run")
    ours = any((out / name).exists() for name in (CONFIG, METRICS, f"{POSED}/{POSES}", f"{FIRST}/{CONFIG}"))
    with making(out):
        if out.is_dir() and not is_empty(out) and not ours:
            raise DataError(out, "is a folder with other contents", "name a new folder, or an earlier run")
        out.mkdir(parents=True, exist_ok=True)


@contextmanager
def prepared(out: Path) -> Iterator[None]:
    """``prepare_folder``, which is gone again if nothing is left in it at the end. Raises ``DataError``."""
    prepare_folder(out)
    try:
        yield
    finally:
        with suppress(OSError):  # where something is left
            out.rmdir()


@contextmanager
def claimed(out: Path) -> Iterator[None]:
    """``prepare_folder``, which is ours alone then, without what killed processes left there. Raises ``DataError``."""
    prepare_folder(out)
    with locked(out, IN_USE), _writing(out):
        remove_parts(out)
        yield


@contextmanager
def _writing(out: Path) -> Iterator[None]:
    """An ``OSError`` here is one of writing to the run folder: a full disk, a folder that is read-only."""
    try:
        yield
    except OSError as error:
        path = Path(error.filename) if error.filename else out
        path = path.parent if path.suffix == PART else path  # by its random name nobody knows it
        problem = f"cannot be written ({error.strerror or error})"
        if error.errno in FORBIDDEN:
            raise DataError(path, problem, "name a folder that can be written, or correct its permissions") from error
        again = "--resume goes on from the checkpoint" if (out / CHECKPOINT).exists() else "start it again"
        raise DataError(path, problem, f"make room on the disk, or check it; {again}") from error


@checks_arguments
def train(
    config: TrainConfig,
    out: Path,
    progress: Callable[[dict], None] = lambda row: None,
    resume: bool = False,
    recipe: Recipe | None = None,
    start: Path | None = None,
    method: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Train, or prune a model (``config.model``), evaluate and write the run folder; returns ``metrics.json``.

    Args:
        progress: called as training starts, with ``notes`` on the data in lines, with every row of the history, and
            when there are none any more, with the number of test views that are ``measured`` then.
        resume: go on from the run's last checkpoint, or from the beginning if it did not come that far, with the same
            settings.
        recipe: takes the place of the preset's; a run that has one goes on with no other.
        start: checkpoint to go on from.
        method: what ``recipe.json`` is to hold, of a method in a comparison; None: the numbers of ``recipe``.

    The model leaves out primitives that can never be seen. An earlier run in the same folder that came to its end is
    replaced: its measurements go first, as they would be a lie beside the new settings; its model stays until the new
    one is complete. Raises ``DataError``, also for one that was stopped unless it is to go on; ``Stopped`` when asked
    to stop in training or after it (Ctrl-C, SIGTERM), which leaves a checkpoint.
    """
    require_class("train: what it trains by", config, TrainConfig, 'give a TrainConfig, as TrainConfig("photos")')
    require_arrays(config.variant)
    out = Path(out)
    _check_settings(config, out, resume)
    # what is wrong with a model shows before the data set takes its time
    model = None if config.model is None else model_to_prune(config.model, config.target, config.format)
    dataset = _dataset_of(config)
    config = _placed(config, dataset)
    trainer = Trainer(config, dataset, recipe, model)
    del model  # its memory is for the training
    if start:
        restore_from(trainer, start)
    if recipe and not method:
        method = described(recipe if config.model is None else recipe.from_pruning())
    with undisguised(progress) as told, _begun(trainer, out, resume, method):
        notes = without_mask(config.masks, (view.name for view in dataset.views))
        notes += without_depth(config.depths, (view.name for view in dataset.train))
        notes += trainer.depths.maps.notes() if trainer.depths else []
        told({"step": trainer.step_count, "n": trainer.optimizer.n, "notes": notes})
        _train(trainer, out, told)
        told({"step": trainer.step_count, "n": trainer.optimizer.n, "measured": len(trainer.dataset.test)})
        with stopped_with(MEASURING):
            return finish(trainer, trainer.dataset, out)


def check_run(config: TrainConfig, out: Path, resume: bool = False) -> None:
    """Raise the ``DataError`` that ``train`` raises for these settings before its first step, as far as that is known
    with one photograph in memory at most. Nothing is written."""
    require_arrays(config.variant)
    _check_settings(config, out, resume)
    dataset = load_dataset(config.data, config.downscale, spp=1, on_disk=True, split=config.split)
    start_of(_placed(config, dataset), dataset)


def _check_settings(config: TrainConfig, out: Path, resume: bool) -> None:
    if not resume:
        require_no_stopped_run(out)
    check_world(config.up, config.scale, config.unit)
    check_inputs(config, out)
    if config.refine_poses:
        require_photographs(Path(config.data))


def train_until(config: TrainConfig, out: Path, step: int, resume: bool = False) -> Path:
    """Train up to a step; returns the checkpoint, in a run folder with a history but without a model.

    Raises what ``train`` raises.
    """
    check_inputs(config, out)
    trainer = Trainer(config, _dataset_of(config))
    with _begun(trainer, out, resume):
        _train(trainer, out, until=step)
    return out / CHECKPOINT


def _dataset_of(config: TrainConfig) -> Dataset:
    return load_dataset(config.data, config.downscale, on_disk=config.data_on_disk, split=config.split)


def _placed(config: TrainConfig, dataset: Dataset) -> TrainConfig:
    """The settings with what is up in the data, and how long their unit is, as far as anybody knows."""
    known = World(config.up, config.unit)
    if config.scale is not None:
        known = World(config.up, metres_of_unit(config.data, config.scale))
    known = known.over(world_of(dataset, [view.camera for view in dataset.train]))
    return dataclasses.replace(config, up=known.up, unit=known.scale)


@contextmanager
def _begun(trainer: Trainer, out: Path, resume: bool, method: Mapping[str, Any] | None = None) -> Iterator[None]:
    """The run folder, ours alone, with nothing in it of another run; the trainer where the run is resumed."""
    with claimed(out):
        if resume:
            resume_run(trainer, out, method)
        else:
            for path in (CHECKPOINT, PLACES, HISTORY):  # old places beside new settings would be those of other data
                (out / path).unlink(missing_ok=True)
        forget_results(out)
        if method:  # a run without it is one of a preset, so that it is there before the settings are
            write_json(out / RECIPE, dict(method))
        else:
            (out / RECIPE).unlink(missing_ok=True)
        write_json(out / CONFIG, dataclasses.asdict(trainer.config))
        note_inputs(trainer.config, out)
        yield


def _train(
    trainer: Trainer, out: Path, progress: Callable[[dict], None] = lambda row: None, until: int | None = None
) -> None:
    """Train to the end, or to a step; rows go to the history, and the state to the checkpoint from time to time and
    at the end."""
    config = trainer.config
    last = config.steps if until is None else until
    checkpoints = Checkpoints(out / CHECKPOINT, config.checkpoint_seconds)
    with open(out / HISTORY, "a", encoding="utf-8") as history, StopRequest() as stop:

        def due() -> bool:
            ends = trainer.step_count == last or stop.signal_number > 0
            return ends or (checkpoints.due() and trainer.sound())

        def save() -> None:
            os.fsync(history.fileno())  # the history is never behind the checkpoint
            checkpoints.save(trainer.state)
            leave()

        def leave() -> None:
            if stop.signal_number:
                where = f"stopped after step {trainer.step_count} of {config.steps}, saved in {out / CHECKPOINT}"
                raise Stopped(f"{where}; the same command with --resume goes on", stop.signal_number)

        try:
            for row in run_to_end(trainer, due, save, until):
                history.write(json_text(row) + "\n")
                history.flush()
                progress(row)
            leave()  # asked for while the last checkpoint was written
        except FloatingPointError as error:
            raise DataError(config.data, str(error), "check its cameras and images for outliers") from error
