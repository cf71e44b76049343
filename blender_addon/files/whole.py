"""Files that are written whole or not at all, and removed or complained of.

Written as ``mi_dogsplat.support.files`` does: a copy on purpose, as the add-on runs without the package.
"""

from __future__ import annotations

import errno
import os
import shutil
import uuid
from contextlib import suppress
from pathlib import Path

from .errors import FileError


def write_whole(path: Path, parts: list[bytes]) -> None:
    """Make ``parts`` the content of ``path``, or leave everything as it was. Raises ``FileError``.

    A new file has the permissions of any other new one, an old one keeps its own. A symbolic link stays one, and the
    file that it leads to is written.
    """
    try:
        target = _written(path)
        # Short: names have at most 255 bytes
        temporary = target.parent / f".{path.name[:40]}.{uuid.uuid4().hex[:12]}.part"
        try:
            with temporary.open("xb") as file:
                file.writelines(parts)
            with suppress(OSError):  # of a new file, and where a disk knows no permissions
                shutil.copymode(target, temporary)
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        remedy = "check that the folder exists, is writable and has space"
        raise FileError(path, "cannot be written ({reason})", remedy, reason=error.strerror) from error


def _written(path: Path) -> Path:
    """What a new content under this name is for: where a link leads, also if nothing is there yet."""
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    if target.is_symlink():  # a circle of links
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
    return target


def remove(path: Path) -> None:
    """Remove a file if it is there. Raises ``FileError``."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        remedy = "close what has it open, and check that its folder is writable"
        raise FileError(path, "cannot be removed ({reason})", remedy, reason=error.strerror) from error
