"""Linux's control groups around this process, by which a container has limits; psutil does not read them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

OWN, ROOT = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")


def groups_around(controller: str) -> Iterator[tuple[int, Path]]:
    """(version of control groups, folder) of each group that may limit this process, those below before those above.

    Version 2 has all ``controller``s in one tree, version 1 each in one of its own. A limit holds for all groups below.
    A container may show its own group as the root.
    """
    try:
        entries = [line.split(":", 2) for line in OWN.read_text().splitlines()]
    except OSError:
        return
    for version, root in ((2, ROOT), (1, ROOT / controller)):
        wanted = "" if version == 2 else controller
        own = [path for _, kinds, path in (e for e in entries if len(e) == 3) if wanted in kinds.split(",")]
        folder = root / (own[-1].strip("/") if own else "")
        yield from ((version, group) for group in (folder, *folder.parents) if group.is_relative_to(root))
