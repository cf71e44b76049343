"""Methods and settings of a comparison that takes seconds."""

from collections.abc import Iterator
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
def without_processes(told: bool = False) -> Iterator[None]:
    """Tasks are performed here, one after another, and what goes wrong is raised; ``told``: bad input is an outcome, as
    it is of processes.

    For tests that ask nothing of processes: each takes seconds to begin.
    """

    def here(task: Task, means: Means) -> str | None:
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
