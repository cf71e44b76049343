"""Files appear whole or not at all: they are written beside the target, brought to the disk, and renamed."""

from __future__ import annotations

import json
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

PART = ".part"  # how a file is called while it is written: .<name>.<random><PART>


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """``with replacing(path) as part``: write to ``part``, which becomes ``path`` if nothing is raised.

    Whenever the process or the machine dies, ``path`` is the old file or the new one, whole; of a process that is
    killed a ``part`` may remain (``remove_parts``).
    """
    path = Path(path)
    part = path.with_name(f".{path.name[:40]}.{uuid.uuid4().hex[:12]}{PART}")  # short: names have at most 255 bytes
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield part
        _to_disk(part)  # a crash after the rename must not leave a name without its content
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    if os.name == "posix":  # elsewhere a folder cannot be opened
        _to_disk(path.parent)


def _to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def remove_parts(folder: Path) -> None:
    """Remove what killed processes left in a folder and below it; nobody may be writing there."""
    for part in folder.rglob(f".*{PART}"):
        part.unlink(missing_ok=True)


def write_json(path: str | Path, value: Any) -> None:
    """Write a value as JSON, indented. Raises ``OSError``."""
    with replacing(path) as part:
        part.write_text(json.dumps(value, indent=2) + "\n", encoding="utf-8")
