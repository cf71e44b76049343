"""Methods and settings of a comparison that takes seconds."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from mi_dogsplat.compare import execute
from mi_dogsplat.compare.execute import Means
from mi_dogsplat.compare.tasks import Task, perform
from mi_dogsplat.support.errors import DataError

NAMES = ("3dgs", "mini_splatting", "mask_gaussian", "dash", "ours")
SETTINGS: dict[str, Any] = {
    "preset": "3dgs",
    "steps": 60,
    "sh_degree": 1,
    "max_primitives": 120,
    "target": 0.25,
    "log_every": 10,
}


@contextmanager
def without_processes(told: bool = False, but: Collection[str] = ()) -> Iterator[None]:
    """Tasks are performed here, one after another, and what goes wrong is raised; ``told``: bad input is an outcome, as
    it is of processes. ``but``: methods whose runs have a process all the same.

    For tests that ask nothing of other processes: each takes seconds to begin.
    """
    in_a_process = execute.in_a_process

    def here(task: Task, means: Means) -> str | None:
        if task.kind == "train" and set(task.methods) & set(but):
            return in_a_process(task, means)
        try:
            perform(task, means.free)
        except DataError as error:
            if not told:
                raise
            return str(error)
        return None

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(execute, "in_a_process", here)
        yield
