"""Who performs the tasks: this machine, one after another, or the workers of a Dask cluster."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .tasks import Task

PACKAGE = Path(__file__).parents[2]  # the folder that the package is in


@dataclass(frozen=True)
class Outcome:
    """Of a task; ``error`` is one line, or None."""

    task: Task
    error: str | None


@dataclass(frozen=True)
class Means:
    """What tasks may use, wherever they are performed."""

    variant: str = "auto"  # of Mitsuba, as for --variant
    threads: int = 0  # of Dr.Jit; 0 takes all cores
    free: dict[str, Any] = field(default_factory=dict)  # settings that no result depends on, by their names


def in_a_process(task: Task, means: Means) -> str | None:
    """Perform a task in a process of its own; returns what went wrong in one line, or None."""
    task.log.parent.mkdir(parents=True, exist_ok=True)
    given = {"task": dataclasses.asdict(task), "means": dataclasses.asdict(means)}
    paths = [str(PACKAGE), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    command = [sys.executable, "-m", "mi_dogsplat.compare", json.dumps(given)]
    with open(task.log, "w", encoding="utf-8") as log:
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=log, env=environment
        )
        with process:
            try:
                status = process.wait()
            finally:
                process.kill()  # does nothing once it has ended
    if status == 0:
        task.log.unlink(missing_ok=True)
        return None
    lines = task.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return lines[-1] if lines else f"the process ended with status {status}"


def one_after_another(tasks: Sequence[Task], means: Means) -> Iterator[Outcome]:
    """Here: with all cores for each, timings are those of an undisturbed run."""
    for task in tasks:
        yield Outcome(task, in_a_process(task, means))
