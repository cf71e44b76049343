"""A comparison as one self-contained page: tables, plots with Pareto fronts, and the same detail by every method."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from ..report.page import TEMPLATES
from ..report.plot import Series, line_plot
from ..report.points import Note
from .crops import MaskOf, crops
from .methods import GROUPS, METHODS
from .nearest import tables_of_equals
from .overview import overview
from .pairs import margin, table_of_pairs
from .table import COLUMNS, cells, columns, data_sets, label
from .ways import ways

PLOTS = {  # what against what
    ("n", "psnr"): "primitives",
    ("train_seconds", "flip"): "training, s",
    ("megabytes", "flip"): "size of the model, MB",
    ("render_ms", "flip"): "render time, ms",
}
COLORS = {group: (color + 1) % len(GROUPS) for color, group in enumerate(GROUPS)}  # ours, the last one: ink
COLOR_OF = {name: COLORS[group] for group, names in GROUPS.items() for name in names}


def comparison_page(out: Path, table: dict[str, Any], masks: Mapping[str, MaskOf] | None = None) -> str:
    """HTML of what ``collect_all`` found in the folder ``out``.

    Args:
        masks: of the views that are measured, by data set; those of others count whole.
    """
    masks = masks or {}
    methods = [(METHODS[name], row["label"]) for name, row in table["methods"].items()]
    return TEMPLATES.get_template("compare/templates/comparison.html").render(
        name=out.resolve().name,
        failed=table["failed"],
        from_the_first_step="; ".join(label for method, label in methods if not method.from_the_start),
        longer="; ".join(label for method, label in methods if method.length != 1),
        methods=table["methods"].values(),
        sections=[_section(out / data, table, data, masks.get(data)) for data in data_sets(table)],
    )


def _section(folder: Path, table: dict[str, Any], data: str, mask_of: MaskOf | None) -> dict[str, Any]:
    """What the page says of a data set; their mean has no folder, so neither pictures nor ways."""
    rows = {name: row | row["data"][data] for name, row in table["methods"].items() if data in row["data"]}
    trained = data in table["config"]
    measured = table["config"].get(data, next(iter(table["config"].values()))).get("split", "test")
    return {
        "name": data,
        "headings": [COLUMNS[name][0] for name in columns(table, data)],
        "rows": [(label(table, data, method), cells(table, data, method)) for method in rows],
        "groups": [(group, COLORS[group]) for group, members in GROUPS.items() if set(members) & set(rows)],
        "points": _points(rows, measured),
        "measured": measured,
        "preconditioned": trained and table["config"][data].get("preconditioned", False),
        "crops": crops(folder, rows, mask_of) if trained else None,
        "ways": ways(folder, rows) if trained else None,
        "overview": overview(folder, rows, COLOR_OF, measured) if trained else None,
        "pairs": table_of_pairs(folder, rows) if trained else None,
        "margin": margin(rows),
        "equals": tables_of_equals(rows, table["config"][data]["target"]) if trained else [],
    }


def pareto(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """[n] indices of the points that none beats in both, small ``x`` and large ``y``, from the smallest x on."""
    order = np.lexsort((-y, x))
    best = np.concatenate([[-np.inf], np.maximum.accumulate(y[order])[:-1]])
    return order[y[order] > best]


def _points(rows: dict[str, Any], measured: str) -> list[Markup]:
    """A plot of all methods for each of ``PLOTS``."""
    names, plots = list(rows), []
    for (x_name, y_name), x_label in PLOTS.items():
        y_label, digits, sign = COLUMNS[y_name]
        x, y = (np.array([rows[name]["summary"][what]["value"] for name in names]) for what in (x_name, y_name))
        front = pareto(x, y * sign)
        series = [Series("Pareto front", x[front], y[front], "faint", 0)]
        for group, members in GROUPS.items():
            for k in (k for k, name in enumerate(names) if name in members):
                name = rows[names[k]]["label"]
                words = f"{name}: {y_label} {y[k]:.{digits}f}, {x_label} {x[k]:,.4g}"
                note = Note(words, name if k in front else "")
                series.append(Series(group, x[[k]], y[[k]], "points", COLORS[group], [note]))
        plots.append(line_plot(series, x_label, f"{measured} {y_label}", log_x=True, legend=False, height=280))
    return plots
