"""How many threads compute on the CPU.

Threads that wait for work spin: more of them than cores take time from those that have some.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .cores import usable_cores


def fit_threads() -> None:
    """At most one for each core that this process may use.

    Dr.Jit starts one for each core of the affinity. In a container with a share of a large machine those are many more
    than can run: with 32 threads on two cores a training step took 20 times as long as with two
    (docs/performance/around.md).
    """
    import drjit as dr

    if dr.thread_count() > usable_cores():
        dr.set_thread_count(usable_cores())


@contextmanager
def threads_to_load() -> Iterator[None]:
    """Two at least, while Mitsuba loads a scene: with one Mitsuba 3.9 waits for ever for an OpenEXR file."""
    import drjit as dr

    before = dr.thread_count()
    dr.set_thread_count(max(2, before))
    try:
        yield
    finally:
        dr.set_thread_count(before)
