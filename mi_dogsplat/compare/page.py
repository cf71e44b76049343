"""A comparison as one self-contained page: tables, plots with Pareto fronts, and the same detail by every method."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from ..report.page import page
from ..report.plot import Series, legend_list, line_plot
from ..report.points import Note
from .crops import crops
from .methods import GROUPS
from .table import COLUMNS, cells, columns, data_sets, label
from .ways import ways

READ_TABLE = """Mean over the seeds, of times the median; ± is half the distance between the best and the
worst of them. Bold: the best of the compact models. Activation: what the test PSNR gains or loses in the step in which
primitives become DoG. All methods of a seed go on from one densified start, except those
that grow to the budget; all end with the same number of steps, and have the same renderer. Render times were taken in
turns, memory is the largest resident size of the process of a run."""
READ_POINTS = """One point per method, mean over the seeds. PSNR: higher is better; FLIP: lower is better; further left
is better. The line joins those that no other method beats in both (the Pareto front), which have a ring and their name;
hover over the others."""
READ_WAYS = """Test PSNR against run time, the common start included: higher and further left is better. Dashed lines
are prunes, by number, and the activation of the DoG. Seed """
PLOTS = {  # what against what
    ("n", "psnr"): "primitives",
    ("train_seconds", "flip"): "training, s",
    ("megabytes", "flip"): "size of the model, MB",
    ("render_ms", "flip"): "render time, ms",
}
COLORS = {group: (color + 1) % len(GROUPS) for color, group in enumerate(GROUPS)}  # ours, the last one: ink


def comparison_page(out: Path, table: dict[str, Any]) -> str:
    """HTML of what ``collect_all`` found in the folder ``out``."""
    body = f"<h1>{escape(out.resolve().name)} <small>comparison</small></h1>"
    for name, error in table["failed"].items():
        body += f"<p class=notice>{escape(name)} has failed: {escape(error)}</p>"
    if not table["methods"]:
        return page(f"{out.resolve().name} · comparison", body + "<p>Nothing is complete yet.</p>")
    body += f"<p class=read>{READ_TABLE}</p>"
    for data in data_sets(table):
        body += f"<h2>{escape(data)}</h2>{_table(table, data)}"
        body += f"<p class=read>{READ_POINTS}</p>{_points(table, data)}"
        if data in table["config"]:
            body += crops(out / data, table, data) + _ways(out / data, table, data)
    sources = "".join(
        f"<tr><td>{escape(row['label'])}<td>{escape(row['source'])}</tr>" for row in table["methods"].values()
    )
    body += f"<h2>Sources</h2><table><tbody>{sources}</tbody></table>"
    return page(f"{out.resolve().name} · comparison", body)


def _table(table: dict[str, Any], data: str) -> str:
    headings = "".join(f"<th class=n>{escape(COLUMNS[name][0])}" for name in columns(table, data))
    rows = ""
    for method, row in table["methods"].items():
        if data in row["data"]:
            texts = cells(table, data, method)
            shown = "".join(f"<td class=n>{'<b>' * best}{escape(text)}{'</b>' * best}" for text, best in texts)
            rows += f"<tr><td>{escape(label(table, data, method))}{shown}</tr>"
    return f"<div class=scroll><table><thead><tr><th>method{headings}</thead><tbody>{rows}</tbody></table></div>"


def pareto(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """[n] indices of the points that none beats in both, small ``x`` and large ``y``, from the smallest x on."""
    order = np.lexsort((-y, x))
    best = np.concatenate([[-np.inf], np.maximum.accumulate(y[order])[:-1]])
    return order[y[order] > best]


def _points(table: dict[str, Any], data: str) -> str:
    rows = {name: row["data"][data]["summary"] for name, row in table["methods"].items() if data in row["data"]}
    names, figures = list(rows), ""
    for (x_name, y_name), x_label in PLOTS.items():
        y_label, digits, sign = COLUMNS[y_name]
        x, y = (np.array([rows[name][what]["value"] for name in names]) for what in (x_name, y_name))
        front = pareto(x, y * sign)
        series = [Series("Pareto front", x[front], y[front], "faint", 0)]
        for group, members in GROUPS.items():
            for k in (k for k, name in enumerate(names) if name in members):
                name = table["methods"][names[k]]["label"]
                words = f"{name}: {y_label} {y[k]:.{digits}f}, {x_label} {x[k]:,.4g}"
                series.append(
                    Series(group, x[[k]], y[[k]], "points", COLORS[group], [Note(words, name if k in front else "")])
                )
        figures += line_plot(series, x_label, f"test {y_label}", log_x=True, legend=False, height=280)
    shown = [(group, COLORS[group]) for group, members in GROUPS.items() if set(members) & set(names)]
    return f"{legend_list(shown)}<div class=plots>{figures}</div>"


def _ways(folder: Path, table: dict[str, Any], data: str) -> str:
    """Of the first seed that has the baseline: a plot per other method; nothing without such a seed."""
    rows = {name: row | row["data"][data] for name, row in table["methods"].items() if data in row["data"]}
    found = ways(folder, rows)
    if not found:
        return ""
    seed, figures = found
    head = f"<h3 class=scene>Error against run time</h3><p class=read>{READ_WAYS}{seed}.</p>"
    return f"{head}<div class=plots>{figures}</div>"
