"""What the run folders of a comparison tell, by method and seed, and what that is on the whole."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..report.run_folder import METRICS, RENDER_MS, read_run
from ..scene.kinds import COUNTED
from ..support.errors import DataError
from ..support.files import read_object
from ..training.events import DogActivated
from .folders import REMEDY
from .method_runs import is_complete
from .methods import METHODS
from .names import AT, seed_order
from .perceptual import LPIPS

TIMES = ("train_seconds", "render_ms", "fps")
Runs = dict[str, dict[str, float]]  # numbers by name, by seed


def collect(folder: Path, names: Iterable[str]) -> dict[str, Runs]:
    """Of a data set: the numbers of the methods that are complete for at least one seed, as they are now: of what they
    were in an earlier version nothing is told."""
    found: dict[str, Runs] = {}
    for name in names:
        for seed, run in _by_seed(folder, name):
            if is_complete(run, METHODS[name]):
                found.setdefault(name, {})[seed] = numbers(run)
    return found


def collect_targets(folder: Path, name: str) -> dict[str, Runs]:
    """Of a data set: the numbers of a method's runs at other targets, by the target."""
    found: dict[str, Runs] = {}
    for seed, run in _by_seed(folder, f"{name}{AT}*"):
        if is_complete(run, METHODS[name]):
            found.setdefault(run.name.partition(AT)[2], {})[seed] = numbers(run)
    return found


def _by_seed(folder: Path, name: str) -> list[tuple[str, Path]]:
    """Seeds and run folders of that name, in the order of the seeds."""
    runs = [(run.parent.name.removeprefix("seed_"), run) for run in sorted(folder.glob(f"seed_*/{name}"))]
    return sorted(runs, key=lambda pair: seed_order(pair[0]))


def numbers(folder: Path) -> dict[str, float]:
    """What a complete run folder tells, by name. Raises ``DataError`` where a file of it is damaged."""
    run = read_run(folder)
    try:
        found = _measured(run.metrics or {})
    except KeyError as missing:
        raise DataError(folder / METRICS, f"has no {missing}", REMEDY) from None
    for name in (RENDER_MS, LPIPS):  # measured with the other runs of a seed
        if (folder / name).exists():
            measured = read_object(folder / name, REMEDY)
            found |= {key: value for key, value in measured.items() if key != "in_turn_with"}
    for i in run.rows_with(DogActivated.kind):
        row = run.history[i]
        if "psnr_before" in row:  # what it costs that primitives become DoG
            found["activation_db"] = row["test_psnr"] - row["psnr_before"]
    return found | {"fps": 1000 / found["render_ms"]}


def _measured(metrics: Mapping[str, Any]) -> dict[str, float]:
    """What a run has measured of itself. Raises ``KeyError`` for what is not there."""
    found = {name: metrics["test"][name] for name in ("psnr", "ssim", "flip")}
    found |= {name: metrics[name] for name in ("n", "n_dog", "train_seconds", "render_ms", "peak_memory_mb")}
    found |= {name: metrics[name] for name in COUNTED if name in metrics}
    return found | {"train_l1": metrics["train"]["l1"], "megabytes": metrics["bytes"] / 1e6}


def summary(runs: Runs) -> dict[str, dict[str, float]]:
    """Mean over the seeds, of times the median (machines have other things to do); and half of their range."""
    result = {}
    for name in dict.fromkeys(name for run in runs.values() for name in run):
        values = [run[name] for run in runs.values() if name in run]
        value = np.median(values) if name in TIMES else np.mean(values)
        result[name] = {"value": float(value), "spread": float(np.ptp(values) / 2)}
    return result
