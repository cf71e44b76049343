"""Which cores the processes of a parallel run of the suite compute on: each, and all that it starts, on one of its own.

Tests launch small kernels and short processes. Dr.Jit and NumPy start a thread for every core that they may use, and
threads that wait for work spin. So several processes that share all cores take longer than each on one.

Importing this gives up the other cores. It comes before all that starts threads.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

THREADS = Path("/proc/self/task")


@contextmanager
def on_all_cores() -> Iterator[None]:
    """Until the end, all threads of this process may run on every core that it was given."""
    if not ALL_CORES:
        yield
        return
    before = os.sched_getaffinity(0)
    _run_on(ALL_CORES)
    try:
        yield
    finally:
        _run_on(before)


def _run_on(cores: set[int]) -> None:
    for thread in THREADS.iterdir():  # what is asked for a process holds for one of its threads
        with suppress(ProcessLookupError):  # it has ended meanwhile
            os.sched_setaffinity(int(thread.name), cores)


def _all_cores() -> set[int]:
    return os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()


ALL_CORES = _all_cores()
WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "0"))  # 0: all tests run in this process

# With fewer or more workers than cores somebody has asked for another share, or a container has less of their time.
if WORKERS and WORKERS == len(ALL_CORES):
    _run_on({sorted(ALL_CORES)[int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw")) % WORKERS]})
