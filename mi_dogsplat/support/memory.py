"""How much memory there is: of the machine, the container, the shell's limit; and amounts as people write them."""

from __future__ import annotations

import re
import resource
from pathlib import Path

UNITS = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
MEMORY, OWN_GROUPS = Path("/proc/meminfo"), Path("/proc/self/cgroup")
# (folder, limit, use) of version 2 and version 1 of Linux's control groups
GROUPS = (
    (Path("/sys/fs/cgroup"), "memory.max", "memory.current"),
    (Path("/sys/fs/cgroup/memory"), "memory.limit_in_bytes", "memory.usage_in_bytes"),
)


def bytes_of(text: str) -> int:
    """``4G``, ``512M``, ``1.5 GB``, ``2GiB`` or plain bytes. Raises ``ValueError``."""
    match = re.fullmatch(r"\s*(\d{1,15}(?:\.\d{1,15})?)\s*([KMGT]?)(I?)B?\s*", text.upper())
    if not match or (match[3] and not match[2]):
        raise ValueError(f'"{text}" is no amount of memory')
    unit = 1024 ** " KMGT".index(match[2]) if match[3] else UNITS[match[2]]
    return int(float(match[1]) * unit)


def available_memory() -> int | None:
    """Bytes that this process can take without being killed for it; None where the system does not say."""
    free = [_machine(), *_groups(), _limit()]
    return min((n for n in free if n is not None), default=None)


def _machine() -> int | None:
    """What Linux estimates that can be had without swapping."""
    try:
        found = re.search(r"^MemAvailable:\s*(\d+) kB", MEMORY.read_text(), re.MULTILINE)
    except OSError:
        return None
    return int(found[1]) * 1024 if found else None


def _groups() -> list[int]:
    """What is left of the limits of the control groups that this process is in."""
    try:
        entries = [line.split(":", 2) for line in OWN_GROUPS.read_text().splitlines()]
    except OSError:
        return []
    own = {kinds: path.strip("/") for _, kinds, path in (entry for entry in entries if len(entry) == 3)}
    left = []
    for (root, limit, use), path in zip(GROUPS, (own.get(""), own.get("memory")), strict=True):
        folder = root / (path or "")
        for group in (folder, *folder.parents):  # a limit holds for all groups below; a container may show its own as /
            if group.is_relative_to(root):
                left.append(_left(group / limit, group / use, group / "memory.stat"))
    return [n for n in left if n is not None]


def _left(limit: Path, use: Path, stat: Path) -> int | None:
    """Limit less use, where what is only kept of files in memory is not in use. None without a limit."""
    try:
        found = re.search(r"^(?:total_)?inactive_file (\d+)", stat.read_text(), re.MULTILINE)
        cached = int(found[1]) if found else 0
    except OSError:
        cached = 0
    try:
        return max(0, int(limit.read_text()) - int(use.read_text()) + cached)
    except (OSError, ValueError):  # no such group, or "max"
        return None


def _limit() -> int | None:
    """What is left of the address space (``ulimit -v``)."""
    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most == resource.RLIM_INFINITY:
        return None
    try:
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except OSError:
        used = 0
    return max(0, most - used)
