"""How much memory there is and was taken; and amounts as people write them."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from .control_groups import groups_around

UNITS = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
STATUS = Path("/proc/self/status")
# limit and use, by the version of control groups
FILES = {1: ("memory.limit_in_bytes", "memory.usage_in_bytes"), 2: ("memory.max", "memory.current")}


def bytes_of(text: str) -> int:
    """``4G``, ``512M``, ``1.5 GB``, ``2GiB`` or plain bytes. Raises ``ValueError``."""
    match = re.fullmatch(r"\s*(\d{1,15}(?:\.\d{1,15})?)\s*([KMGT]?)(I?)B?\s*", text.upper())
    if not match or (match[3] and not match[2]):
        raise ValueError(f'"{text}" is not an amount of memory')
    unit = 1024 ** " KMGT".index(match[2]) if match[3] else UNITS[match[2]]
    return int(float(match[1]) * unit)


def available_memory() -> int | None:
    """Bytes that this process can take without being killed for it; None where the system does not say.

    The least of what the machine can give without swapping, what is left of the limits of a container, and what is left
    of the address space (``ulimit -v``).
    """
    import psutil  # here: the core has modules that import this one, and never ask

    free = _groups()
    try:
        process = psutil.Process()
        free.append(psutil.virtual_memory().available)
        most = process.rlimit(psutil.RLIMIT_AS)[0] if hasattr(psutil, "RLIMIT_AS") else -1  # not on macOS and Windows
        if most >= 0:  # else there is none
            free.append(max(0, most - process.memory_info().vms))
    except (OSError, psutil.Error):  # Linux without /proc
        pass
    return min(free, default=None)


def peak_memory_mb() -> float:
    """Largest resident size of this process so far, in units of 10^6 bytes.

    Linux counts it for each program that a process becomes; ``getrusage`` begins with what its parent had.
    """
    if STATUS.exists():
        return int(STATUS.read_text().split("VmHWM:")[1].split()[0]) * 2**10 / 1e6
    if sys.platform == "win32":
        import psutil

        return psutil.Process().memory_info().peak_wset / 1e6
    import resource  # not on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 2**10) / 1e6


def _groups() -> list[int]:
    """What is left of the limits of the control groups around this process."""
    groups = ((group, *FILES[version]) for version, group in groups_around("memory"))
    left = [_left(group / limit, group / use, group / "memory.stat") for group, limit, use in groups]
    return [n for n in left if n is not None]


def _left(limit: Path, use: Path, stat: Path) -> int | None:
    """Limit less use, where what is only kept of files in memory is not in use. None without a limit."""
    try:
        found = re.findall(r"^(?:total_)?inactive_file (\d+)", stat.read_text(), re.MULTILINE)
        cached = max(map(int, found), default=0)  # version 1 has what groups below use in another line
    except OSError:
        cached = 0
    try:
        return max(0, int(limit.read_text()) - int(use.read_text()) + cached)
    except (OSError, ValueError):  # no such group, or "max"
        return None
