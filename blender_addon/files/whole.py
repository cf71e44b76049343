"""Files that are written whole or not at all, and removed or complained of."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from .errors import FileError


def write_whole(path: Path, parts: list[bytes]) -> None:
    """Make ``parts`` the content of ``path``, or leave everything as it was. Raises ``FileError``."""
    try:
        handle, temporary = tempfile.mkstemp(".part", f".{path.name}.", path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.writelines(parts)
            os.replace(temporary, path)
        finally:
            Path(temporary).unlink(missing_ok=True)
    except OSError as error:
        remedy = "check that the folder exists, is writable and has space"
        raise FileError(path, "cannot be written ({reason})", remedy, reason=error.strerror) from error


def remove(path: Path) -> None:
    """Remove a file if it is there. Raises ``FileError``."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        remedy = "close what has it open, and check that its folder is writable"
        raise FileError(path, "cannot be removed ({reason})", remedy, reason=error.strerror) from error
