"""How many processor cores this process may use, which need not be all that the machine has."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

OWN_GROUP, GROUPS = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")


def usable_cores() -> int:
    """Cores of this process's affinity (``taskset``, batch systems), or fewer where a container has less of their time.

    Dr.Jit starts a thread for each core of the affinity.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min([cores, *(max(1, math.ceil(share)) for share in _shares())])


def _shares() -> list[float]:
    """Processor time per time, of each of Linux's control groups (version 2) around this process that has a limit."""
    try:
        own = re.search(r"^0::/(.*)$", OWN_GROUP.read_text(), re.MULTILINE)
    except OSError:
        return []
    folder, shares = GROUPS / (own[1] if own else ""), []
    for group in (folder, *folder.parents):
        try:
            quota, period = (group / "cpu.max").read_text().split()
            shares.append(int(quota) / int(period))
        except (OSError, ValueError):  # no such group, or "max"
            continue
    return shares
