"""How many processor cores this process may use, which need not be all that the machine has."""

from __future__ import annotations

import math
import os
from pathlib import Path

OWN_GROUP, GROUPS = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")
OF_VERSION_1, OF_VERSION_2 = ("cpu.cfs_quota_us", "cpu.cfs_period_us"), ("cpu.max",)


def usable_cores() -> int:
    """Cores of this process's affinity (``taskset``, batch systems), or fewer where a container has less of their time.

    Dr.Jit starts a thread for each core of the affinity (``threads.py``).
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min([cores, *(max(1, math.ceil(share)) for share in _shares())])


def _shares() -> list[float]:
    """Processor time per time, of each of Linux's control groups around this process that has a limit.

    Of version 2, which has all in one tree, or of version 1, where processor time has one of its own.
    """
    try:
        groups = [line.split(":", 2) for line in OWN_GROUP.read_text().splitlines()]
    except OSError:
        return []
    shares = []
    for _, controllers, own in groups:
        if controllers and "cpu" not in controllers.split(","):
            continue
        tree, files = (GROUPS / "cpu", OF_VERSION_1) if controllers else (GROUPS, OF_VERSION_2)
        folder = tree / own.lstrip("/")
        for group in (folder, *folder.parents):
            try:
                quota, period = " ".join((group / file).read_text() for file in files).split()
                share = int(quota) / int(period)
            except (OSError, ValueError):  # no such group, or "max"
                continue
            if share > 0:  # -1 is no limit
                shares.append(share)
    return shares
