"""Training error against wall-clock time, from the histories of run folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..report.run_folder import HISTORY, Run, read_run
from ..report.smoothing import running_mean, thinned
from ..support.errors import DataError
from ..support.wording import finite

MAX_RUNS = 7  # as many colours as a plot of curves can tell apart
COLUMNS = {"l1": "l1", "psnr": "test_psnr", "flip": "test_flip"}  # name here: in the history


def read_training(folders: Sequence[Path]) -> list[dict[str, Any]]:
    """Of each run: ``run``, ``label``, ``seconds`` in all, ``n``, ``final`` metrics, and the curves of ``COLUMNS``.

    A curve is a list of [seconds, value]; ``l1`` is the running mean of the report, over the training views; ``psnr``
    and ``flip`` are over the test views and end with what the finished run measured. Raises ``DataError``.
    """
    if len(folders) > MAX_RUNS:
        raise DataError("--runs", f"{len(folders)} runs are given", f"compare at most {MAX_RUNS}")
    runs = [read_run(folder) for folder in folders]
    for run in runs:
        if not np.isfinite(run.column("l1") * run.column("seconds")).any():
            raise DataError(run.path, f"has no {HISTORY} with a logged step", "give a run folder of dogsplat train")
    labels = [_label(run) for run in runs]
    return [
        _curves(run, label if labels.count(label) == 1 else f"{label} ({run.path})")
        for run, label in zip(runs, labels, strict=True)
    ]


def _label(run: Run) -> str:
    """Data and method, and which views were measured where these are no test views."""
    views = "" if run.measured == "test" else f"{run.measured} views"
    return " · ".join(filter(None, (run.data_name, run.method, views)))


def _curves(run: Run, label: str) -> dict[str, Any]:
    seconds, metrics = run.column("seconds"), run.metrics or {}
    curves: dict[str, list[list[float]]] = {}
    for name, column in COLUMNS.items():
        values = run.column(column)
        known = np.isfinite(values) & np.isfinite(seconds)
        x, y = seconds[known], values[known]
        if name == "l1":
            x, y = thinned(x, running_mean(y)[0])
        curves[name] = np.stack([x, y], 1).tolist()
    total = finite(metrics.get("train_seconds")) or float(np.nanmax(seconds))
    test = metrics.get("test") or {}
    for name in ("psnr", "flip"):
        last, curve = finite(test.get(name)), curves[name]
        if last is not None and not (curve and curve[-1][0] >= total):
            curve.append([total, last])
    final = {name: value for name, value in test.items() if finite(value) is not None}
    n = metrics.get("n", run.history[-1].get("n"))  # of the model, which leaves out what has faded
    return {"run": str(run.path), "label": label, "seconds": total, "n": n, "final": final, **curves}
