"""A comparison: data sets x seeds x methods, and the tables and the page that tell how it went.

    DIR/DATA/views.json           names of the views that all runs of a data set are on
    DIR/DATA/seed_K/start.npz     the shared start: the 3DGS recipe up to the end of its densification
    DIR/DATA/seed_K/start/        its run folder, with its history
    DIR/DATA/seed_K/METHOD/       a run folder like any other; METHOD.log beside it says why a run has failed
    DIR/comparison.json, .csv, .md, .tex
    DIR/comparison.html           the same, and plots and pictures; rewritten whenever a task ends

What is complete is not repeated, and what was cut off goes on from its checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
from contextlib import closing, contextmanager, nullcontext
from dataclasses import replace
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np

from ..datasets import load_dataset
from ..datasets.depths import Depths
from ..datasets.masks import Masks, all_black
from ..support.arguments import checks_arguments, require_path
from ..support.cores import usable_cores
from ..support.errors import DataError, making
from ..support.files import is_empty, remove_parts, replacing, write_json
from ..support.locks import locked
from ..support.wording import counted
from ..training.config import FREE, TrainConfig
from .cluster import cluster_client, on_cluster
from .crops import MaskOf
from .execute import Means, one_after_another
from .folders import claim, claim_views
from .methods import METHODS
from .numbers import numbers
from .page import comparison_page
from .table import COMPARISON, collect_all, write_tables
from .targets import counted_target
from .tasks import Task, all_tasks


@checks_arguments
def compare(
    config: TrainConfig,
    data: Sequence[str],
    out: Path,
    seeds: Sequence[int] = (0,),
    methods: Sequence[str] = tuple(METHODS),
    cluster: str | None = None,
    workers: int = 0,
    targets: Sequence[float] = (),
    progress: Callable[[str], None] = lambda line: None,
) -> dict[str, Any]:
    """Train every method on every data set with every seed; returns what ``comparison.json`` holds.

    Args:
        config: steps, target and so on; its data, preset and seed are not used, and it has neither ``growth`` nor
            ``model``. The target is that of all methods.
        data: data sets, by the names of their folders in the result.
        out: folder of the comparison, made if need be.
        methods: names in ``METHODS``.
        cluster: address of a Dask scheduler.
        workers: without an address, of a Dask cluster on this machine; 0 runs one after another.
        targets: that compact methods are trained to beside that of ``config``, for tables of equal bytes and time.
        progress: called with a line as a task ends.

    A task that fails is a line and a note in the table; the others go on, but for runs whose start has failed. Raises
    ``DataError`` for bad data or arguments, a folder that holds something else, or a cluster that cannot be had.
    """
    _check_arguments(config, data, seeds, methods, cluster, workers)
    targets = [counted_target("--more-targets", target) for target in targets]
    out = Path(out)
    folders = [out / name for name in _names(data)]
    _check_folder(out)
    views, masks_of_each = zip(*(_views_of(path, config) for path in data), strict=True)
    masks_of = {folder.name: of for folder, of in zip(folders, masks_of_each, strict=True) if of}
    on_dask = cluster is not None or workers > 0
    with cluster_client(cluster, workers) if on_dask else nullcontext() as client, _locked(out):
        if not (out / COMPARISON).exists():
            write_json(out / COMPARISON, {})  # by which the folder is known
        # whole paths: another call, and a worker of a cluster, may have another working folder
        beside = {name: getattr(config, name) for name in ("masks", "depths")}
        whole = {name: None if path is None else str(Path(path).resolve()) for name, path in beside.items()}
        for folder, path, names in zip(folders, data, views, strict=True):
            claim(folder, replace(config, data=str(Path(path).resolve()), **whole))
            claim_views(folder, names)
        numbers_of_seeds = [int(seed) for seed in seeds]  # those of NumPy are in no JSON
        tasks = [task for task in all_tasks(folders, numbers_of_seeds, methods, targets) if not task.done]
        failed: dict[str, str] = {}
        _write(out, failed, masks_of)
        threads = max(1, usable_cores() // workers) if workers and not cluster else 0
        means = Means(config.variant, threads, {name: getattr(config, name) for name in FREE})
        outcomes = on_cluster(tasks, means, client) if on_dask else one_after_another(tasks, means)
        with closing(outcomes):  # while there is a client: Ctrl-C may come here, and what still runs saves first
            for number, outcome in enumerate(outcomes, 1):
                if outcome.error:
                    failed[outcome.task.name] = outcome.error
                _write(out, failed, masks_of)
                progress(f"{number}/{len(tasks)} {outcome.task.name}: {_result(outcome.task, outcome.error)}")
    return collect_all(out, failed)


def _views_of(path: str, config: TrainConfig) -> tuple[dict[str, list[str]], MaskOf | None]:
    """Names of the views of a data set, ``train`` and ``test``, and masks of the latter, by their names, where there
    are some. Raises ``DataError`` for what no methods can be compared on."""
    dataset = load_dataset(path, config.downscale, split=config.split)
    if not dataset.test:
        raise DataError(path, f"has no {config.split} views to compare methods on", "give it a test split")
    names = {part: [view.name for view in getattr(dataset, part)] for part in ("train", "test")}
    if config.depths:
        Depths(config.depths, dataset)  # as trainings ask: each of them would say what is wrong
    if not config.masks:
        return names, None
    masks = Masks(config.masks, dataset.train)  # likewise
    if all(mask is not None and not mask.any() for mask in map(masks.of, dataset.test)):
        raise all_black(config.masks, "view that is measured")
    known = {view.name: replace(view, stored=np.zeros(0)) for view in dataset.test}  # without their images
    return names, lambda name: masks.of(known[name]) if name in known else None


def _check_arguments(
    config: TrainConfig, data: Sequence[str], seeds: Sequence[int], methods: Sequence[str], cluster: str | None,
    workers: int,
) -> None:  # fmt: skip
    """Raises ``DataError``, which names the flag, for what no comparison can be made of."""
    for flag, given in (("DATA", data), ("--seeds", seeds), ("--only", methods)):
        if isinstance(given, str) or not isinstance(given, Sized):
            raise DataError(flag, f'is "{given}"', "give a list, even of only one")
        if not len(given):
            raise DataError(flag, "is empty", "give at least one")
    for path in data:
        require_path("DATA", path)
    if unknown := [name for name in methods if name not in METHODS]:
        raise DataError("--only", f'"{unknown[0]}" is unknown', f"use {', '.join(METHODS)}")
    if broken := [seed for seed in seeds if not isinstance(seed, Integral)]:
        raise DataError("--seeds", f"{broken[0]!r} is not a whole number", "use 0, 1, 2 and so on")
    if min(seeds) < 0:
        raise DataError("--seeds", f"{min(seeds)} is out of range", "use at least 0")
    if workers < 0:
        raise DataError("--workers", f"{workers} is out of range", "use at least 0")
    if workers and cluster is not None:
        problem = "is for runs on this machine, and --cluster has workers of its own"
        raise DataError("--workers", problem, "leave one of them out")
    if config.growth is not None:
        remedy = 'leave it out; the methods of the set "early" have a shorter growth of their own'
        raise DataError("--growth", "changes schedules that are part of the methods", remedy)
    if config.model is not None:
        raise DataError("--model", "would give runs another start, and all runs of a seed share theirs", "leave it out")
    counted_target("--target", config.target)


def _names(data: Sequence[str]) -> list[str]:
    """Of the data sets in the result. Raises ``DataError`` if two are one."""
    paths = [Path(path).resolve() for path in data]
    names = [path.name if path.is_dir() else path.stem for path in paths]
    for name in names:
        if names.count(name) > 1:
            raise DataError(name, "is the name of two data sets", "rename one of them")
    return names


def _check_folder(out: Path) -> None:
    """Raises ``DataError`` for a folder that is not one of a comparison."""
    if out.exists() and not out.is_dir():
        raise DataError(out, "is a file", "name a folder for the comparison")
    if out.is_dir() and not is_empty(out) and not (out / COMPARISON).exists():
        raise DataError(out, "is a folder with other contents", "name a new folder, or an earlier comparison")


@contextmanager
def _locked(out: Path) -> Iterator[None]:
    """The folder is ours alone, without what killed processes left in it; runs look after theirs."""
    with making(out):
        out.mkdir(parents=True, exist_ok=True)
    with locked(out, "another comparison is writing to it"):
        remove_parts(out, below=False)
        yield


def _write(out: Path, failed: dict[str, str], masks: Mapping[str, MaskOf]) -> None:
    """The tables and the page, of all runs that are there now."""
    table = collect_all(out, failed)
    write_tables(out, table)
    with replacing(out / "comparison.html") as part:
        part.write_text(comparison_page(out, table, masks), encoding="utf-8")


def _result(task: Task, error: str | None) -> str:
    """How a task ended, in a few words."""
    if error:
        return f"failed: {error}"
    if task.kind != "train":
        return "done"
    run = numbers(task.seed_folder / task.methods[0])
    return f"{run['psnr']:.2f} dB, {counted(run['n'], 'primitive')}, {run['train_seconds']:.0f} s"
