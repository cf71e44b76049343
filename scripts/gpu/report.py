"""What came out, as one page of Markdown for docs/benchmarks.md, and as JSON."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from mi_dogsplat.support.wording import counted

PAGE, DATA = "report.md", "report.json"
GOOD = ("passed", "not run", "stopped")


def failed(report: dict[str, Any]) -> list[str]:
    """Names of the steps that failed, or that hung until they were stopped."""
    return [name for name, step in report["steps"].items() if step["outcome"] not in GOOD]


def write(report: dict[str, Any], out: Path) -> None:
    """Write both files to a folder, each whole or not at all."""
    for name, text in ((DATA, json.dumps(report, indent=1) + "\n"), (PAGE, markdown(report))):
        part = out / f"{name}.part"
        part.write_text(text, encoding="utf-8")
        os.replace(part, out / name)


def markdown(report: dict[str, Any]) -> str:
    """The page: the machine, what was run and how it ended, then a table of each step that has figures."""
    machine, versions = report["machine"], report.get("versions", {})
    lines = [f"## On a GPU: {machine['gpu']}", ""]
    lines += [
        f"**Machine**: {machine['gpu']}, {machine['gpu_memory_mb']:,} MiB, driver {machine['driver']}; "
        f"{machine['processor']}, {counted(machine['cores'], 'core')}; {machine['system']}"
        + "".join(f", {name} {version}" for name, version in versions.items())
        + f". `{report['command']}`, commit {report['commit']}.",
        "",
        *table([_summary(name, step) for name, step in report["steps"].items()]),
    ]
    for name, step in report["steps"].items():
        if step["rows"]:
            lines += ["", f"### {step['title']}", "", f"`{step['command']}`", "", *table(step["rows"])]
        if step["failed"]:
            lines += ["", f"Failed in `{name}`:", "", *(f"- `{test}`" for test in step["failed"])]
    return "\n".join(lines) + "\n"


def _summary(name: str, step: dict[str, Any]) -> dict[str, Any]:
    return {"step": f"`{name}`", "outcome": step["outcome"], "seconds": round(step["seconds"], 1), "": step["says"]}


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Lines of a Markdown table; a column for each key, in the order in which they come up."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    lines = [_line(columns), "|---" * len(columns) + "|"]
    return lines + [_line([_cell(row.get(column)) for column in columns]) for row in rows]


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _cell(value: Any) -> str:
    """Whole numbers with commas, others with four digits that count, nothing for what is missing."""
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1e4 else f"{value:.4g}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    return str(value).replace("|", "\\|").replace("\n", " ")
