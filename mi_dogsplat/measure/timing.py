"""Wall times that can be compared on a machine that does other things, too."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np


def milliseconds_in_turn(jobs: Mapping[Any, Callable[[], object]], rounds: int) -> dict[Any, float]:
    """Median wall time of each job in ms, after one run of each that does not count: it compiles the kernels.

    The jobs take turns, so that what else the machine does slows all alike. A job returns when its work is done.
    """
    times: dict[Any, list[float]] = {key: [] for key in jobs}
    for job in jobs.values():
        job()
    for _ in range(rounds):
        for key, job in jobs.items():
            start = time.perf_counter()
            job()
            times[key].append(time.perf_counter() - start)
    return {key: float(np.median(values) * 1e3) for key, values in times.items()}
