"""How many processor cores this process may use: those of its affinity, not all that the machine has."""

from __future__ import annotations

import os


def usable_cores() -> int:
    """At least 1. Dr.Jit starts as many threads; ``taskset`` and batch systems give a process fewer than there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
