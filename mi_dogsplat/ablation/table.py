"""The table of an ablation: means and spread over seeds, read from the run folders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ..report.run_folder import RENDER_MS
from ..support.files import replacing, write_json

COLUMNS = {  # name: (heading, digits)
    "psnr": ("PSNR (dB)", 2),
    "ssim": ("SSIM", 4),
    "flip": ("FLIP", 4),
    "train_l1": ("train L1", 5),
    "n": ("primitives", 0),
    "n_dog": ("of them DoG", 0),
    "megabytes": ("MB", 2),
    "train_seconds": ("training (s)", 0),
    "render_ms": ("render (ms)", 2),
    "activation_db": ("activation (dB)", 3),
}
TIMES = ("train_seconds", "render_ms", "fps")


def collect(out: Path, names: list[str]) -> dict[str, dict[str, dict[str, float]]]:
    """Numbers by variant and seed, of the variants that are complete for at least one seed."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    for name in names:
        for folder in sorted(out.glob(f"seed_*/{name}")):
            if (folder / "metrics.json").exists():
                found.setdefault(name, {})[folder.parent.name.removeprefix("seed_")] = numbers(folder)
    return found


def numbers(folder: Path) -> dict[str, float]:
    """What a complete run folder tells, by name."""
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    found = {name: metrics["test"][name] for name in ("psnr", "ssim", "flip")}
    found |= {name: metrics[name] for name in ("n", "n_dog", "train_seconds", "render_ms", "peak_memory_mb")}
    found |= {"train_l1": metrics["train"]["l1"], "megabytes": metrics["bytes"] / 1e6}
    in_turn = folder / RENDER_MS
    if in_turn.exists():
        found["render_ms"] = json.loads(in_turn.read_text(encoding="utf-8"))["render_ms"]
    for line in (folder / "history.jsonl").read_text(encoding="utf-8").splitlines():
        row = json.loads(line)
        if "psnr_before" in row:  # what it costs that primitives become DoG
            found["activation_db"] = row["test_psnr"] - row["psnr_before"]
    return found


def summary(runs: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """Mean over the seeds, of times the median (machines have other things to do); and half of their range."""
    result = {}
    for name in dict.fromkeys(name for run in runs.values() for name in run):
        values = [run[name] for run in runs.values() if name in run]
        value = np.median(values) if name in TIMES else np.mean(values)
        result[name] = {"value": float(value), "spread": float(np.ptp(values) / 2)}
    return result


def cell(row: dict[str, Any], name: str) -> str:
    """Text of a column of a row: value ± spread, without the spread for a single seed, empty without a number."""
    return with_spread(row, name, COLUMNS[name][1])


def with_spread(row: dict[str, Any], name: str, digits: int) -> str:
    """``cell`` with so many digits."""
    value = row["summary"].get(name)
    if not value:
        return ""
    return f"{value['value']:,.{digits}f}" + (f" ± {value['spread']:.{digits}f}" if len(row["runs"]) > 1 else "")


def markdown(table: dict[str, Any]) -> str:
    """The table as Markdown; ± is half the distance between the best and the worst seed."""
    lines = ["| variant | seeds | " + " | ".join(heading for heading, _ in COLUMNS.values()) + " |"]
    lines.append("|---" * (len(COLUMNS) + 2) + "|")
    for row in table["variants"].values():
        cells = (row["label"], str(len(row["runs"])), *(cell(row, name) for name in COLUMNS))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def write_table(out: Path, labels: dict[str, str]) -> dict[str, Any]:
    """Make ``ablation.json`` and ``ablation.md`` of the runs in a folder; returns what the former holds.

    Args:
        labels: text of each variant's row, by the name of its run folders, in order.
    """
    config = json.loads((out / "config.json").read_text(encoding="utf-8"))
    found = collect(out, list(labels))
    rows = {name: {"label": labels[name], "summary": summary(runs), "runs": runs} for name, runs in found.items()}
    table = {"config": config, "variants": rows}
    write_json(out / "ablation.json", table)
    with replacing(out / "ablation.md") as part:
        part.write_text(markdown(table), encoding="utf-8")
    return table
