"""``check.html``: what ``check.json`` holds, as one self-contained page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from ..report.page import TEMPLATES
from ..report.plot import Series, line_plot
from ..report.points import Note
from ..report.ticks import number
from ..support.wording import duration, finite, time_unit
from .curves import GROUPS
from .tables import Table, cell, facts, table

BUSY = 0.5  # processes
CLOUD_HEIGHT = 300  # of a plot of settings, user units: many lie close together


@dataclass(frozen=True)
class Section:
    """Plots and numbers; names and colours of the series where no other section has them."""

    plots: Sequence[Markup]
    numbers: Table
    legend: Sequence[tuple[str, int]] = ()


def check_page(report: Mapping[str, Any]) -> str:
    """HTML of a report as ``run.check`` makes it; parts that it does not hold are left out."""
    machine, scenes = report.get("machine") or {}, report.get("work_precision") or []
    return TEMPLATES.get_template("check/templates/check.html").render(
        name=str(report.get("model_name") or "numerics"),
        machine=facts(machine),
        busy=(finite(machine.get("load")) or 0) > BUSY and scenes,
        defaults=next(row for row in scenes[-1]["rows"] if row["default"]) if scenes else None,
        cell=cell,
        knobs=[("default, and no cutoffs", 0), *((group, GROUPS.index(group) + 1) for group in _groups(scenes))],
        scenes=[(scene, _work_precision(scene["rows"])) for scene in scenes],
        training=_training(report["training"]) if report.get("training") else None,
        verdicts=[row.get("verdict") for row in report.get("stability") or []],
        stability=table(report.get("stability") or []),
    )


def _groups(scenes: Iterable[Mapping[str, Any]]) -> list[str]:
    """Those that have a setting."""
    found = {row["group"] for scene in scenes for row in scene["rows"]}
    return [group for group in GROUPS if group in found]


def _work_precision(rows: Sequence[Mapping[str, Any]]) -> Section:
    clouds = (
        _cloud(rows, "forward_ms", "mean_error", "image_front", "forward, ms", "mean error of the image"),
        _cloud(rows, "total_ms", "worst_gradient_error", "gradient_front", "forward + backward, ms",
               "relative error, worst gradient"),
    )  # fmt: skip
    return Section([cloud for cloud in clouds if cloud], table([_numbers(row) for row in rows]))


def _cloud(rows: Sequence[Mapping[str, Any]], x: str, y: str, front: str, x_label: str, y_label: str) -> Markup | None:
    """All settings of a scene; the default is drawn once, above the curves that go through it."""
    known = [row for row in rows if (finite(row[x]) or 0) > 0 and (finite(row[y]) or 0) > 0]
    if not known:
        return None
    best = sorted((row for row in known if row[front]), key=lambda row: row[x])
    series = [Series("Pareto front", *_columns(best, x, y), "dashed", 0)] if best else []
    for group in (*GROUPS, ""):
        some = [row for row in known if row["group"] == group]
        notes = []
        for row in some:
            words = f"{group} {row['setting']}".strip()
            shown = row[front] and not (group and row["default"])
            title = f"{words}: {number(float(f'{row[y]:.2g}'))}, {row[x]:.3g} ms"
            notes.append(Note(title, row["setting"] if shown else ""))
        if group:
            color = GROUPS.index(group) + 1
            series.append(Series(group, *_columns(some, x, y), "points", color, notes))
        else:  # two settings that no curve joins
            columns = zip(*_columns(some, x, y), notes, strict=True)
            series += [Series("default", np.array([a]), np.array([b]), "points", 0, [note]) for a, b, note in columns]
    return line_plot(series, x_label, y_label, log_x=True, log_y=True, legend=False, height=CLOUD_HEIGHT)


def _columns(rows: Iterable[Mapping[str, Any]], x: str, y: str) -> tuple[np.ndarray, np.ndarray]:
    rows = list(rows)
    return np.array([row[x] for row in rows], np.float64), np.array([row[y] for row in rows], np.float64)


def _numbers(row: Mapping[str, Any]) -> dict[str, Any]:
    """A line of the table of a scene."""
    fronts = [word for word, key in (("image", "image_front"), ("gradient", "gradient_front")) if row[key]]
    return {
        "group": row["group"], "setting": row["setting"] + (" (default)" if row["default"] and row["group"] else ""),
        "forward": row["forward_ms"], "+ backward": row["total_ms"], "mean error": row["mean_error"],
        "max error": row["max_error"], "PSNR, dB": row["psnr"], "rounding": row["rounding_error"],
        **row["gradient_error"], "Pareto front": ", ".join(fronts),
    }  # fmt: skip


def _training(runs: Sequence[Mapping[str, Any]]) -> Section:
    longest = max(run["seconds"] for run in runs)
    unit, scale = time_unit(longest)
    plots = []
    for key, label in {"l1": "training L1", "psnr": "PSNR, dB", "flip": "FLIP"}.items():
        series = []
        for i, run in enumerate(runs):
            points = np.array(run[key], np.float64).reshape(-1, 2)
            if key == "l1":
                series.append(Series(run["label"], points[:, 0] / scale, points[:, 1], color=i + 1))
            else:
                notes = [Note(f"{run['label']}: {number(float(f'{y:.4g}'))} after {duration(x)}") for x, y in points]
                series.append(Series(run["label"], points[:, 0] / scale, points[:, 1], "points", i + 1, notes))
        if any(len(s.x) for s in series):
            plots.append(line_plot(series, f"run time, {unit}", label, log_y=key == "l1", legend=False))
    rows = [
        {"run": run["label"], "time": duration(run["seconds"]), "primitives": run["n"], **run["final"]} for run in runs
    ]
    return Section(plots, table(rows), [(run["label"], i + 1) for i, run in enumerate(runs)])
