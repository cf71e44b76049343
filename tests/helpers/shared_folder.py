"""Folders that are made once for all processes of a test run, by the one that comes first; nobody writes to them."""

import hashlib
from collections.abc import Callable, Iterator
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


def unchanged_folder(base: Path, name: str, write: Callable[[Path], object]) -> Iterator[Path]:
    """What a fixture yields: the folder, of which its end makes sure that no test has changed it.

    ``base``: where pytest puts the folders of this process (``tmp_path_factory.getbasetemp()``).
    """
    of_all_processes = base.parent if base.name.startswith("popen") else base
    folder = shared_folder(of_all_processes, name, write)
    before = contents(folder)
    yield folder
    assert contents(folder) == before, f"a test has changed the shared folder {folder}; let it have a copy"


def contents(folder: Path) -> dict[str, str]:
    """A digest of each file of a folder, by its path in there."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
