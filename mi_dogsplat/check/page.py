"""``check.html``: what ``check.json`` holds, as one self-contained page."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from ..report.page import page
from ..report.plot import Mark, Series, legend_list, line_plot, number
from ..report.points import Note
from ..support.wording import duration, finite, fixed
from .settings import GROUPS
from .tables import cell, facts, table

READ_WORK = """Each point is a setting of the engine, each curve one knob turned from the default (large diamond):
further down is nearer to the truth, further left is faster. The truth is the formula in float64 without any cutoff.
Ringed and joined by the dashed line are the settings that no other one beats in both (the Pareto front). The second
large diamond has no cutoffs: what remains there is float32. “Primitives kept” are the best by leave-one-out score in
this very view. Point at a mark for its numbers."""
READ_NUMBERS = """Times are medians in ms, all settings in turns. Errors of the image are absolute, colours from 0 to
1; “rounding” is the mean error against float64 with the same cutoffs. An error of a gradient is the distance to the
right one over its length, per parameter."""
READ_TRAINING = """The same error against wall-clock time for each run, its densification included: a run is better
where it is below (L1, FLIP) or above (PSNR) another one at the same time. L1 is that of the training views, as a
running mean; PSNR and FLIP are of the test views."""
READ_STABILITY = """Each row is an input that breaks naive splatting code. “right” agrees with float64 within the
tolerance of the tests, “defined” follows a documented rule where the formula has no answer (the note says which),
“wrong” is a defect. Errors are relative."""
READ_CURVATURE = """How sharply the loss bends along each parameter: plain gradient descent diverges with steps above
its limit, 2 over the largest curvature; where these limits lie far apart the problem is stiff."""
READ_POISONED = """The same training twice. To the second one primitives are added on purpose, at the marked steps, that
are stiff, extreme or not finite (infinite, or not a number). It recovers when its curve returns to the first. Nothing
may spread: below is counted, over all steps, what else became not finite, and each of these four counts must be 0."""

POISONED_FACTS = {
    "injected": "primitives added",
    "dropped": "primitives dropped",
    "spread": "other primitives not finite",
    "bad_images": "images not finite",
    "bad_losses": "losses not finite",
    "bad_moments": "moments of Adam not finite",
    "psnr_clean": "final PSNR without them, dB",
    "psnr_poisoned": "final PSNR with them, dB",
}

NOISY = """The machine was busy when this began (see load), so that the run times are noise in part: errors are not, but
which settings are on the front is. Repeat it on a quiet machine."""
BUSY = 0.5  # processes
CLOUD_HEIGHT = 300  # of a plot of settings, user units: many lie close together


def check_page(report: Mapping[str, Any]) -> str:
    """HTML of a report as ``run.check`` makes it; parts that it does not hold are left out."""
    name = str(report.get("model_name") or "numerics")
    parts: dict[str, Callable[[Any], str]] = {
        "work_precision": _work_precision,
        "training": _training,
        "stability": _stability,
        "stiffness": _stiffness,
    }
    sections = [write(report[key]) for key, write in parts.items() if report.get(key)]
    machine = report.get("machine") or {}
    head = f"<h1>{escape(name)} <small>check</small></h1>{_summary(report)}{facts(machine)}"
    if (finite(machine.get("load")) or 0) > BUSY and report.get("work_precision"):
        head += f"<p class=notice>{NOISY}</p>"
    return page(f"{name} · check", "\n".join([head, *sections]))


def _summary(report: Mapping[str, Any]) -> str:
    """The few numbers to know: the default setting on the last scene (the model, if there is one), and the verdicts."""
    tiles = []
    if scenes := report.get("work_precision"):
        row, where = next(r for r in scenes[-1]["rows"] if r["default"]), escape(scenes[-1]["name"])
        forward, total = (fixed(row[key], 1) for key in ("forward_ms", "total_ms"))
        tiles = [
            ("Image error ↓", cell(row["mean_error"]), f"mean, defaults, {where}"),
            ("of it rounding ↓", cell(row["rounding_error"]), "float32 against float64"),
            ("Gradient error ↓", cell(row["worst_gradient_error"]), "relative, the worst parameter"),
            ("Forward", f"{forward} <small>ms</small>", f"{total} with backward"),
        ]
    if rows := report.get("stability"):
        verdicts = [row.get("verdict") for row in rows]
        words = f"{verdicts.count('defined')} of them defined, {verdicts.count('wrong')} wrong"
        tiles.append(("Stability", f"{len(rows)} <small>cases</small>", words))
    if runs := report.get("training"):
        tiles.append(("Training", f"{len(runs)} <small>runs</small>", "error against wall-clock time"))
    html = "".join(
        f"<div class=tile><div class=name>{name}</div><div class=value>{value}</div><div class=more>{more}</div></div>"
        for name, value, more in tiles
    )
    return f"<div class=tiles>{html}</div>"


def _work_precision(scenes: Sequence[Mapping[str, Any]]) -> str:
    groups = [g for g in GROUPS if any(row["group"] == g for scene in scenes for row in scene["rows"])]
    legend = legend_list([("default, and no cutoffs", 0), *((g, GROUPS.index(g) + 1) for g in groups)])
    body = ""
    for scene in scenes:
        what = f"{escape(scene['what'])}; {scene['width']} x {scene['height']} pixels"
        plots = (
            _cloud(scene["rows"], "forward_ms", "mean_error", "image_front", "forward, ms", "mean error of the image"),
            _cloud(scene["rows"], "total_ms", "worst_gradient_error", "gradient_front", "forward + backward, ms",
                   "relative error, worst gradient"),
        )  # fmt: skip
        numbers = table([_numbers(row) for row in scene["rows"]])
        body += (
            f"<h3 class=scene>{escape(scene['name'])}</h3><p class=read>{what}</p>"
            f"<div class=plots>{''.join(plots)}</div>"
            f"<details><summary>All numbers</summary><p class=read>{READ_NUMBERS}</p>{numbers}</details>"
        )
    return f"<h2>Error against run time</h2><p class=read>{READ_WORK}</p>{legend}{body}"


def _cloud(rows: Sequence[Mapping[str, Any]], x: str, y: str, front: str, x_label: str, y_label: str) -> str:
    """All settings of a scene; the default is drawn once, above the curves that go through it."""
    known = [row for row in rows if (finite(row[x]) or 0) > 0 and (finite(row[y]) or 0) > 0]
    if not known:
        return ""
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


def _training(runs: Sequence[Mapping[str, Any]]) -> str:
    longest = max(run["seconds"] for run in runs)
    unit, scale = ("s", 1) if longest < 180 else ("min", 60) if longest < 3 * 3600 else ("h", 3600)
    figures = ""
    for key, label in {"l1": "training L1", "psnr": "test PSNR, dB", "flip": "test FLIP"}.items():
        series = []
        for i, run in enumerate(runs):
            points = np.array(run[key], np.float64).reshape(-1, 2)
            if key == "l1":
                series.append(Series(run["label"], points[:, 0] / scale, points[:, 1], color=i + 1))
            else:
                notes = [Note(f"{run['label']}: {number(float(f'{y:.4g}'))} after {duration(x)}") for x, y in points]
                series.append(Series(run["label"], points[:, 0] / scale, points[:, 1], "points", i + 1, notes))
        if any(len(s.x) for s in series):
            figures += line_plot(series, f"run time, {unit}", label, log_y=key == "l1", legend=False)
    legend = legend_list([(run["label"], i + 1) for i, run in enumerate(runs)])
    rows = [
        {"run": run["label"], "time": duration(run["seconds"]), "primitives": run["n"], **run["final"]} for run in runs
    ]
    head = f"<h2>Training error against run time</h2><p class=read>{READ_TRAINING}</p>"
    return f"{head}{legend}<div class=plots>{figures}</div>{table(rows)}"


def _stability(rows: Sequence[Mapping[str, Any]]) -> str:
    return f"<h2>Stability</h2><p class=read>{READ_STABILITY}</p>{table(rows)}"


def _stiffness(found: Mapping[str, Any]) -> str:
    html = ""
    if rows := found.get("curvature"):
        html += f"<h2>Stiffness</h2><p class=read>{READ_CURVATURE}</p>{table([_by_case(row) for row in rows])}"
    if poisoned := found.get("poisoned"):
        html += f"<h2>Training with poisoned primitives</h2><p class=read>{READ_POISONED}</p>{_poisoned(poisoned)}"
    return html


def _by_case(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of curvatures, for a table in groups."""
    return {"group" if key == "case" else key: value for key, value in row.items()}


def _poisoned(values: Mapping[str, Any]) -> str:
    """Lists of [step, number] are curves, mappings of numbers are marks at steps, the rest are facts."""
    curves = {key: value for key, value in values.items() if _is_curve(value)}
    marks = [Mark(str(k), float(x)) for v in values.values() if isinstance(v, Mapping) for k, x in v.items()]
    colors = range(1, len(curves) + 1)
    series = [
        Series(name, *np.array(curve, np.float64).T, color=color)
        for color, (name, curve) in zip(colors, curves.items(), strict=True)
    ]
    plot = line_plot(series, "step", "test PSNR, dB", marks=marks) if series else ""
    single = {
        POISONED_FACTS.get(key, key): value for key, value in values.items() if not isinstance(value, list | Mapping)
    }
    return f"<div class=plots>{plot}</div>{facts(single)}"


def _is_curve(value: object) -> bool:
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(point, list) and len(point) == 2 and None not in map(finite, point) for point in value)
    )
