"""Each method's way beside that of the baseline: test PSNR against run time, from one densified start."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..report.plot import Series, line_plot
from ..report.prunes import marks
from ..report.run_folder import Run, read_run


def ways(out: Path, rows: dict[str, Any]) -> tuple[str, str] | None:
    """The first seed that has the baseline, and a plot per other row with the ways of both; None without such a seed.

    Args:
        out: where ``seed_K/NAME`` are run folders.
        rows: "label" and "runs" by name.
    """
    baseline = rows.get("3dgs")
    if not baseline:
        return None
    seed = min(baseline["runs"])
    folder = out / f"seed_{seed}"
    others = {name: row for name, row in rows.items() if name != "3dgs" and seed in row["runs"]}
    x, y = _way(folder / "3dgs")[1:]
    figures = ""
    for name, row in others.items():
        run, minutes, psnr = _way(folder / name)
        if not len(minutes):
            continue  # it was never measured on the way: --test-every beyond its end
        curves = [Series(row["label"], minutes, psnr), Series(baseline["label"], x, y, color=2)]
        lines = marks(run, run.column("seconds") / 60)
        figures += line_plot(curves, "run time, min", "test PSNR, dB", marks=lines, x_start=float(np.min(minutes)))
    return seed, figures


def _way(folder: Path) -> tuple[Run, np.ndarray, np.ndarray]:
    """The run, and minutes and test PSNR where it was measured, before the activation of the DoG included."""
    run = read_run(folder)
    minutes, psnr, before = run.column("seconds") / 60, run.column("test_psnr"), run.column("psnr_before")
    activated = np.flatnonzero(np.isfinite(before))
    minutes, psnr = np.insert(minutes, activated, minutes[activated]), np.insert(psnr, activated, before[activated])
    known = np.isfinite(psnr)
    return run, minutes[known], psnr[known]
