"""How many processor cores this process may use, which need not be all that the machine has."""

from __future__ import annotations

import math
import os

from .control_groups import groups_around

FILES = {1: ("cpu.cfs_quota_us", "cpu.cfs_period_us"), 2: ("cpu.max",)}  # by the version of control groups


def usable_cores() -> int:
    """Cores of this process's affinity (``taskset``, batch systems), or fewer where a container has less of their time.

    Dr.Jit starts a thread for each core of the affinity (``threads.py``).
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min([cores, *(max(1, math.ceil(share)) for share in _shares())])


def _shares() -> list[float]:
    """Processor time per time, of each control group around this process that has a limit."""
    shares = []
    for version, group in groups_around("cpu"):
        try:
            quota, period = " ".join((group / file).read_text() for file in FILES[version]).split()
            share = int(quota) / int(period)
        except (OSError, ValueError):  # no such group, or "max"
            continue
        if share > 0:  # -1 is no limit
            shares.append(share)
    return shares
