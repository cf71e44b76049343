"""Who performs the tasks: this machine, one after another, or the workers of a Dask cluster."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from .tasks import Task

PACKAGE = Path(__file__).parents[2]  # the folder that the package is in


@dataclass(frozen=True)
class Outcome:
    """Of a task; ``error`` is one line, or None."""

    task: Task
    error: str | None


def in_a_process(task: Task, variant: str, threads: int) -> str | None:
    """Perform a task in a process of its own; returns what went wrong in one line, or None.

    Args:
        variant: of Mitsuba, as for ``--variant``.
        threads: of Dr.Jit; 0 takes all cores.
    """
    task.log.parent.mkdir(parents=True, exist_ok=True)
    given = dataclasses.asdict(task) | {"variant": variant, "threads": threads}
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
        task.log.unlink()
        return None
    lines = task.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return lines[-1] if lines else f"the process ended with status {status}"


def one_after_another(tasks: Sequence[Task], variant: str) -> Iterator[Outcome]:
    """Here, with all cores for each: timings are those of an undisturbed run."""
    for task in tasks:
        yield Outcome(task, in_a_process(task, variant, 0))
