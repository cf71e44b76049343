"""The numbers of a comparison, read from the run folders, as JSON, CSV and LaTeX.

A row per method; for each data set the mean over its seeds, as in the tables of the papers; of times the median.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..report.run_folder import CONFIG
from ..scene.kinds import COUNTED
from ..support.files import replacing, write_json
from ..support.wording import counted
from .folders import settings_in
from .methods import METHODS
from .names import AT, seed_order
from .numbers import collect, collect_targets, summary

COMPARISON = "comparison.json"
COLUMNS = {  # name: (heading, digits, which is best: 1 the largest, -1 the smallest, 0 neither)
    "n": ("primitives", 0, 0),
    **{name: (kind, 0, 0) for name, kind in COUNTED.items()},
    "megabytes": ("MB", 2, 0),
    "psnr": ("PSNR (dB)", 2, 1),
    "ssim": ("SSIM", 4, 1),
    "flip": ("FLIP", 4, -1),
    "lpips": ("LPIPS", 3, -1),
    "train_l1": ("train L1", 5, -1),
    "activation_db": ("activation (dB)", 3, 0),
    "train_seconds": ("training (s)", 0, -1),
    "fps": ("FPS", 0, 1),
    "peak_memory_mb": ("memory (MB)", 0, -1),
}
MEAN = "mean over the data sets"


def collect_all(out: Path, failed: dict[str, str]) -> dict[str, Any]:
    """What ``comparison.json`` holds: settings and, of each method, numbers by data set; and what has failed."""
    folders = [path.parent for path in sorted(out.glob(f"*/{CONFIG}"))]
    rows: dict[str, dict[str, Any]] = {}
    for folder in folders:
        for name, runs in collect(folder, METHODS).items():
            method = METHODS[name]
            about = {"label": method.label, "source": method.source, "deviations": method.deviations}
            row = rows.setdefault(name, about | {"data": {}})
            others = {t: {"summary": summary(o), "runs": o} for t, o in collect_targets(folder, name).items()}
            row["data"][folder.name] = {"summary": summary(runs), "runs": runs, "others": others}
    names = [folder.name for folder in folders]
    for row in rows.values():
        if len(names) > 1 and list(row["data"]) == names:
            row["data"][MEAN] = _mean(list(row["data"].values()))
    methods = {name: rows[name] for name in METHODS if name in rows}
    config = {folder.name: settings_in(folder) for folder in folders}
    return {"config": config, "methods": methods, "failed": failed}


def _mean(data: list[dict[str, Any]]) -> dict[str, Any]:
    """Of the means over seeds, of numbers that every data set has."""
    names = [name for name in data[0]["summary"] if all(name in d["summary"] for d in data)]
    means = {name: float(np.mean([d["summary"][name]["value"] for d in data])) for name in names}
    return {"summary": {name: {"value": mean, "spread": 0.0} for name, mean in means.items()}, "runs": {}, "others": {}}


def data_sets(table: dict[str, Any]) -> list[str]:
    """Those that have a row, and their mean where there is one, which comes first."""
    names = dict.fromkeys(name for row in table["methods"].values() for name in row["data"])
    return sorted(names, key=lambda name: name != MEAN)


def columns(table: dict[str, Any], data: str) -> list[str]:
    """Those that have a number."""
    found = {name for row in table["methods"].values() for name in row["data"].get(data, {"summary": {}})["summary"]}
    return [name for name in COLUMNS if name in found]


def label(table: dict[str, Any], data: str, method: str) -> str:
    """Of a row; with its seeds where these are not the same for all rows: their number, or where that is, which."""
    rows = {name: row["data"][data]["runs"] for name, row in table["methods"].items() if data in row["data"]}
    seeds = {name: tuple(sorted(runs, key=seed_order)) for name, runs in rows.items()}
    own, words = seeds[method], ""
    if len({len(some) for some in seeds.values()}) > 1:
        words = f" ({counted(len(own), 'seed')})"
    elif len(set(seeds.values())) > 1:
        words = f" (seed{'s' * (len(own) != 1)} {', '.join(own)})"
    return table["methods"][method]["label"] + words


def cells(table: dict[str, Any], data: str, method: str) -> list[tuple[str, bool]]:
    """Of a row: text, and whether it is the best of the compact models (the baseline with all primitives is none)."""
    rows, result = {key: row["data"][data] for key, row in table["methods"].items() if data in row["data"]}, []
    for name in columns(table, data):
        _, digits, sign = COLUMNS[name]
        values = {key: row["summary"][name]["value"] * sign for key, row in rows.items() if name in row["summary"]}
        compact = {key: value for key, value in values.items() if METHODS[key].compact}
        best = sign != 0 and len(compact) > 1 and compact.get(method) == max(compact.values())
        result.append((_with_spread(rows[method], name, digits), best))
    return result


def _with_spread(row: dict[str, Any], name: str, digits: int) -> str:
    """Value ± spread, without the spread where a single seed has a number, empty where none has."""
    value = row["summary"].get(name)
    if not value:
        return ""
    seeds = sum(name in run for run in row["runs"].values())  # what was cut off has not measured all of them yet
    return f"{value['value']:,.{digits}f}" + (f" ± {value['spread']:.{digits}f}" if seeds > 1 else "")


def write_tables(out: Path, table: dict[str, Any]) -> None:
    """Make ``comparison.json``, ``.csv`` (a line per run), ``.md`` and ``.tex`` (for the package booktabs)."""
    write_json(out / COMPARISON, table)
    with replacing(out / "comparison.csv") as part, open(part, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["data", "method", "seed", *COLUMNS])
        for *run, numbers in _runs(table):
            writer.writerow([*run, *(numbers.get(column, "") for column in COLUMNS)])
    for suffix, write in ((".md", markdown), (".tex", latex)):
        with replacing(out / f"comparison{suffix}") as part:
            part.write_text("\n".join(write(table, data) for data in data_sets(table)), encoding="utf-8")


def _runs(table: dict[str, Any]) -> Iterator[tuple[str, str, str, dict[str, Any]]]:
    """(data set, method, with its target where it has another one, seed, numbers) of each run."""
    for method, row in table["methods"].items():
        for data, of_data in row["data"].items():
            runs = {method: of_data["runs"]}
            runs |= {f"{method}{AT}{target}": other["runs"] for target, other in of_data["others"].items()}
            for name, of_seeds in runs.items():
                yield from ((data, name, seed, numbers) for seed, numbers in of_seeds.items())


def _lines(table: dict[str, Any], data: str, bold: str) -> list[list[str]]:
    """Headings, then label and cells of each row; ``bold`` is the template for the best of the compact models."""
    lines = [["method", *(COLUMNS[name][0] for name in columns(table, data))]]
    for method, row in table["methods"].items():
        if data in row["data"]:
            texts = [bold.format(text) if best else text for text, best in cells(table, data, method)]
            lines.append([label(table, data, method), *texts])
    return lines


def markdown(table: dict[str, Any], data: str) -> str:
    """A table under the name of the data set; the best of the compact models in bold."""
    headings, *rows = _lines(table, data, "**{}**")
    lines = [f"| {' | '.join(headings)} |", "|---" * len(headings) + "|", *(f"| {' | '.join(row)} |" for row in rows)]
    return "\n".join([f"## {data}", "", *lines, ""])


def latex(table: dict[str, Any], data: str) -> str:
    """A tabular; the best of the compact models in bold."""
    headings, *rows = _lines(table, data, r"\textbf{{{}}}")
    texts = [" & ".join(row).replace("%", r"\%").replace("±", r"$\pm$") + r" \\" for row in rows]
    head = [f"% {data}", rf"\begin{{tabular}}{{l{'r' * (len(headings) - 1)}}}", r"\toprule"]
    return "\n".join([*head, " & ".join(headings) + r" \\", r"\midrule", *texts, r"\bottomrule", r"\end{tabular}", ""])
