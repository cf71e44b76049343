"""What the steps left behind, as rows of a table and one line: counts of tests, figures, the state of a training."""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

OUTCOME = re.compile(r"\b(PASSED|FAILED|ERROR|SKIPPED|XFAIL|XPASS)\b")
TEST = re.compile(r"\btests/\S+\.py(::\S+)?")
FIGURES = ("psnr", "ssim", "flip")
COMPARED = ("method", "seed", "n", "megabytes", *FIGURES, "train_seconds", "peak_memory_mb")


@dataclass(frozen=True)
class Result:
    """``says`` in one line what came out; ``rows`` are the lines of a table, ``failed`` the names of failed tests."""

    says: str = ""
    rows: list[dict[str, Any]] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)


def last_line(log: Path) -> Result:
    """The last line that a program said."""
    lines = [line.strip() for line in log.read_text(encoding="utf-8", errors="replace").splitlines()]
    return Result(next((line for line in reversed(lines) if line), "said nothing"))


def tests(log: Path) -> Result:
    """Outcomes in the output of ``pytest -v``, also of one that was stopped on its way."""
    counts: Counter[str] = Counter()
    failed: dict[str, None] = {}
    for line in log.read_text(encoding="utf-8", errors="replace").splitlines():
        if line.startswith("="):  # what follows repeats names
            if "FAILURES" in line or "ERRORS" in line or "short test summary" in line:
                break
            continue
        outcome, test = OUTCOME.search(line), TEST.search(line)
        if outcome and test:
            counts[outcome[1].lower()] += 1
            if outcome[1] in ("FAILED", "ERROR"):
                failed[test[0]] = None
    says = ", ".join(f"{n} {outcome}" for outcome, n in counts.items()) or last_line(log).says
    return Result(says, failed=list(failed))


def figures(file: Path, log: Path) -> Result:
    """The rows that a benchmark has written to a JSON file so far, and the last line that it said."""
    rows = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else []
    return Result(last_line(log).says, rows)


def training(run: Path, log: Path) -> Result:
    """Where a run folder stands: how far it is, or what its metrics are."""
    history, config = run / "history.jsonl", run / "config.json"
    if not history.is_file() or not history.stat().st_size:
        return last_line(log)
    settings = json.loads(config.read_text(encoding="utf-8"))
    last = json.loads(history.read_text(encoding="utf-8").splitlines()[-1])
    row = {
        "data": Path(settings["data"]).name, "preset": settings["preset"], "steps": last["step"],
        "of": settings["steps"], "training, s": round(last["seconds"], 1),
        "ms a step": 1e3 * last["seconds"] / max(1, last["step"]), "primitives": last["n"], "DoG": last["n_dog"],
    }
    if not (run / "metrics.json").is_file():
        return Result(f"at step {last['step']:,} of {settings['steps']:,}; the same command goes on", [row])
    metrics = json.loads((run / "metrics.json").read_text(encoding="utf-8"))
    row |= {name: metrics["test"].get(name) for name in FIGURES}
    row |= {"MB": metrics["bytes"] / 1e6, "render, ms": metrics["render_ms"]}
    return Result(f"complete, {settings['steps']:,} steps", [row])


def comparison(folder: Path, log: Path) -> Result:
    """The methods that a comparison has measured so far."""
    file = folder / "comparison.csv"
    if not file.is_file():
        return last_line(log)
    with file.open(encoding="utf-8", newline="") as lines:
        rows = [{name: _number(row[name]) for name in COMPARED} for row in csv.DictReader(lines)]
    return Result(last_line(log).says, rows)


def _number(text: str) -> str | int | float | None:
    """Of a cell: a number where it is one, nothing where it is empty."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text or None
