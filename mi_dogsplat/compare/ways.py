"""Each method's way beside that of the baseline: test PSNR against run time, from one densified start."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from ..report.plot import Series, line_plot
from ..report.prunes import marks
from ..report.run_folder import Run, read_run
from .names import seed_order

BASELINE = "3dgs"


def ways(out: Path, rows: dict[str, Any]) -> tuple[str, list[Markup]] | None:
    """The first seed that has the baseline, and a plot per other row with the ways of both; None without such a seed.

    Args:
        out: where ``seed_K/NAME`` are run folders.
        rows: "label" and "runs" by name.
    """
    baseline = rows.get(BASELINE)
    if not baseline:
        return None
    seed = min(baseline["runs"], key=seed_order)
    folder = out / f"seed_{seed}"
    x, y = _way(folder / BASELINE)[1:]
    plots = []
    for name, row in rows.items():
        if name == BASELINE or seed not in row["runs"]:
            continue
        run, minutes, psnr = _way(folder / name)
        if not len(minutes):
            continue  # its history is gone
        curves = [Series(row["label"], minutes, psnr), Series(baseline["label"], x, y, color=2)]
        lines = marks(run, run.column("seconds") / 60)
        plots.append(
            line_plot(curves, "run time, min", f"{run.measured} PSNR, dB", marks=lines, x_start=float(np.min(minutes)))
        )
    return seed, plots


def _way(folder: Path) -> tuple[Run, np.ndarray, np.ndarray]:
    """The run, and minutes and test PSNR where it was measured, before the activation of the DoG included."""
    run = read_run(folder)
    minutes, psnr, before = run.column("seconds") / 60, run.measured_column("psnr"), run.column("psnr_before")
    activated = np.flatnonzero(np.isfinite(before))
    minutes, psnr = np.insert(minutes, activated, minutes[activated]), np.insert(psnr, activated, before[activated])
    known = np.isfinite(psnr)
    return run, minutes[known], psnr[known]
