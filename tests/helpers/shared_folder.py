"""Folders that are made once for all processes of a test run, by the one that comes first; nobody writes to them."""

import hashlib
from collections.abc import Callable
from pathlib import Path

from filelock import FileLock


def shared_folder(base: Path, name: str, write: Callable[[Path], object]) -> Path:
    """``base / name``, which ``write`` has filled."""
    folder, part = base / name, base / f"{name}.part"
    with FileLock(base / f"{name}.lock"):
        if not folder.exists():
            write(part)
            part.rename(folder)
    return folder


def contents(folder: Path) -> dict[str, str]:
    """A digest of each file of a folder, by its path in there."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
