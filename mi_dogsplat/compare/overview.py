"""Error against run time of all methods of a seed in one picture: what somebody gets who stops at any moment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from ..report.plot import Series, line_plot
from ..report.points import Note
from ..report.run_folder import Run, read_run
from .names import OURS, SUFFIX, seed_order

ERRORS = {"psnr": "PSNR, dB", "flip": "FLIP"}
START = "start"  # the run folder of the densified start
DECIBELS, TIMES = 8.0, 3.0  # below the best PSNR, of the best FLIP: what is worse is not drawn
NAMED = ("3dgs", "paper", "ours")  # beside their ends, and the furthest of ours; the others have a name to point at


def overview(
    folder: Path, rows: dict[str, Any], colors: Mapping[str, int], measured: str
) -> tuple[str, list[Markup]] | None:
    """The first seed that all share, or the least there is, and a plot for each of ``ERRORS`` that was measured.

    Args:
        folder: of the data set within the comparison.
        rows: "label" and "runs" by name.
        colors: of each method.
        measured: on which views.
    """
    seeds = [set(row["runs"]) for row in rows.values()]
    if not seeds:
        return None
    seed = min(set.intersection(*seeds) or set.union(*seeds), key=seed_order)
    runs = {name: read_run(folder / f"seed_{seed}" / name) for name, row in rows.items() if seed in row["runs"]}
    begun = folder / f"seed_{seed}" / START
    plots = []
    for metric, error in ERRORS.items():
        more_is_better, words = metric == "psnr", f"{measured} {error}"
        ways = {}
        for name, run in runs.items():
            kind = "dashed" if name.endswith(SUFFIX) else "line"
            ways[name] = _way(rows[name]["label"], run, metric, kind, colors[name])
        best = max if more_is_better else min
        level = best((best(way.y) for way in ways.values() if len(way.y)), default=0.0)
        limit = level - DECIBELS if more_is_better else level * TIMES
        drawn = {name: _good_part(way, limit, more_is_better) for name, way in ways.items()}
        drawn = {name: way for name, way in drawn.items() if len(way.x)}
        if drawn:
            start = [_way("the densified start", read_run(begun), metric, "faint", 0)] if begun.is_dir() else []
            start = [_good_part(way, limit, more_is_better) for way in start]
            furthest = [name for name in (*OURS, "ours_early") if name in drawn][-1:]
            ends = [_end(way, words, name in (*NAMED, *furthest)) for name, way in drawn.items()]
            plots.append(line_plot([*start, *drawn.values(), *ends], "run time, min", words, legend=False, height=340))
    return (seed, plots) if plots else None


def _way(label: str, run: Run, metric: str, kind: str, color: int) -> Series:
    values, minutes = run.measured_column(metric), run.column("seconds") / 60
    known = np.isfinite(values)
    return Series(label, minutes[known], values[known], kind, color)


def _good_part(way: Series, limit: float, more_is_better: bool) -> Series:
    """What is on the good side of ``limit``."""
    kept = way.y >= limit if more_is_better else way.y <= limit
    return replace(way, x=way.x[kept], y=way.y[kept])


def _end(way: Series, words: str, named: bool) -> Series:
    """The last point, with a name to point at, or beside it."""
    note = Note(f"{way.label}: {words} {way.y[-1]:.4g} after {way.x[-1]:.2g} min", way.label if named else "")
    return Series(way.label, way.x[-1:], way.y[-1:], "points", way.color, [note])
