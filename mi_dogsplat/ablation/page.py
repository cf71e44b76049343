"""An ablation as one self-contained page: the table, and each variant's way beside that of the baseline."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from ..report.page import TEMPLATES
from ..report.plot import Series, line_plot
from ..report.prunes import marks
from ..report.run_folder import read_run
from .table import COLUMNS, cell

PAGE = '{% extends "report/templates/base.html" %}{% block body %}{{ body }}{% endblock %}'
READ_TABLE = """Mean over the seeds, of times the median; ± is half the distance between the best and the worst of
them. All variants of a seed go on from the same densified model and end with the same number of steps. Render times
were taken in turns.
Activation: what the test PSNR gains or loses in the step in which primitives become DoG."""
READ_PLOTS = """Test PSNR against run time, the common start included: higher and further left is better. Dashed lines
are prunes, by number, and the activation of the DoG. Seed """


def ablation_page(out: Path, table: dict[str, Any]) -> str:
    """HTML of what ``write_table`` made of the folder ``out``."""
    data = Path(str(table["config"].get("data", ""))).name or out.resolve().name
    rows, headings = "", "".join(f"<th class=n>{escape(heading)}" for heading, _ in COLUMNS.values())
    for row in table["variants"].values():
        cells = "".join(f"<td class=n>{escape(cell(row, name))}</td>" for name in COLUMNS)
        rows += f"<tr><td>{escape(row['label'])}</td><td class=n>{len(row['runs'])}</td>{cells}</tr>"
    grid = f"<table><thead><tr><th>variant<th class=n>seeds{headings}</tr></thead><tbody>{rows}</tbody></table>"
    head = f"<h1>{escape(data)} <small>ablation</small></h1><p class=read>{READ_TABLE}</p>"
    body = Markup(f"{head}<div class=scroll>{grid}</div>{_plots(out, table)}")
    return TEMPLATES.from_string(PAGE).render(title=f"{data} · ablation", body=body)


def _plots(out: Path, table: dict[str, Any]) -> str:
    found = ways(out, table["variants"])
    if not found:
        return ""
    seed, figures = found
    return f"<h2>Error against run time</h2><p class=read>{READ_PLOTS}{seed}.</p><div class=plots>{figures}</div>"


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


def _way(folder: Path) -> tuple[Any, np.ndarray, np.ndarray]:
    """The run, and minutes and test PSNR where it was measured, before the activation of the DoG included."""
    run = read_run(folder)
    minutes, psnr, before = run.column("seconds") / 60, run.column("test_psnr"), run.column("psnr_before")
    activated = np.flatnonzero(np.isfinite(before))
    minutes, psnr = np.insert(minutes, activated, minutes[activated]), np.insert(psnr, activated, before[activated])
    known = np.isfinite(psnr)
    return run, minutes[known], psnr[known]
