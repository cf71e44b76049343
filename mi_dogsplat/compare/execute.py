"""Who performs the tasks: this machine, one after another, or the workers of a Dask cluster."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .tasks import Task

PACKAGE = Path(__file__).parents[2]  # the folder that the package is in
STOP = b"s"  # on the standard input of a task's process: save, and end
SECONDS_BETWEEN_QUESTIONS = 1.0
# Ctrl-C in a terminal goes to a whole group of processes: this one alone passes it on, once
OWN_GROUP: dict[str, Any] = (
    {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP} if sys.platform == "win32" else {"start_new_session": True}
)


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


def in_a_process(task: Task, means: Means, asked: Callable[[], bool] = lambda: False) -> str | None:
    """Perform a task in a process of its own; returns what went wrong in one line, or None.

    Where ``asked`` says so, or Ctrl-C comes, which is raised again, the process saves first what it has done; who
    presses Ctrl-C once more does not wait for that.
    """
    task.log.parent.mkdir(parents=True, exist_ok=True)
    given = {"task": dataclasses.asdict(task), "means": dataclasses.asdict(means)}
    paths = [str(PACKAGE), *filter(None, [os.environ.get("PYTHONPATH")])]
    # its log is UTF-8, whatever the locale is
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "PYTHONIOENCODING": "utf-8"}
    command = [sys.executable, "-m", "mi_dogsplat.compare", json.dumps(given)]
    try:
        with open(task.log, "w", encoding="utf-8") as log:
            process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=log, env=environment, **OWN_GROUP
            )
            status = _status_at_the_end(process, asked)
    except KeyboardInterrupt:
        task.log.unlink(missing_ok=True)  # nothing has failed
        raise
    if status == 0 or asked():
        task.log.unlink(missing_ok=True)
        return None if status == 0 else "stopped"
    lines = task.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return lines[-1] if lines else f"the process ended with status {status}"


def _status_at_the_end(process: subprocess.Popen, asked: Callable[[], bool]) -> int:
    with process:
        try:
            return _status(process, asked)
        except KeyboardInterrupt:
            _ask_to_stop(process)
            process.wait()
            raise
        finally:
            process.kill()  # does nothing once it has ended


def _status(process: subprocess.Popen, asked: Callable[[], bool]) -> int:
    while True:
        try:
            return process.wait(SECONDS_BETWEEN_QUESTIONS)
        except subprocess.TimeoutExpired:
            if asked():
                _ask_to_stop(process)
                return process.wait()


def _ask_to_stop(process: subprocess.Popen) -> None:
    assert process.stdin
    with contextlib.suppress(OSError):  # it has ended meanwhile
        process.stdin.write(STOP)
        process.stdin.flush()


def one_after_another(tasks: Sequence[Task], means: Means) -> Generator[Outcome, None, None]:
    """Here: with all cores for each, timings are those of an undisturbed run."""
    waiting = list(tasks)
    while waiting:
        outcome = Outcome(waiting[0], in_a_process(waiting[0], means))
        waiting = still_possible(waiting[1:], outcome)
        yield outcome


def still_possible(waiting: Sequence[Task], outcome: Outcome) -> list[Task]:
    """What is left to do after an outcome: a run without its start is not, and that has been told once."""
    return [task for task in waiting if not (outcome.error and task.begins_with(outcome.task))]
