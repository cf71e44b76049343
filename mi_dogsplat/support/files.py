"""Files appear whole or not at all: they are written beside the target, brought to the disk, and renamed."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import sys
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from .errors import DataError, writing

PART = ".part"  # how a file is called while it is written: .<name>.<random><PART>
LOCK = ".lock"  # in a folder that a process writes to (locks.py)
LITTER = (".DS_Store", "Thumbs.db", "desktop.ini")  # that file managers leave in folders which somebody looked at
WORDS = {"Infinity": "1e999", "NaN": "null"}  # of json.dumps, which are no JSON, and what is written in their place
_STRING_OR_WORD = re.compile(r'"(?:[^"\\]|\\.)*"|' + "|".join(WORDS))


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """``with replacing(path) as part``: write to ``part``, which becomes ``path`` if nothing is raised.

    Whenever the process or the machine dies, ``path`` is the old file or the new one, whole; of a process that is
    killed a ``part`` may remain (``remove_parts``). An ``OSError`` of writing names ``path``.

    Where ``path`` is a symbolic link, it stays one, and the file that it leads to is written. A new file has the
    permissions of any other new one, an old one keeps its own.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    target = written_file(path)
    part = target.with_name(f".{path.name[:40]}.{uuid.uuid4().hex[:12]}{PART}")  # short: names have at most 255 bytes
    try:
        yield part
        _to_disk(part)  # a crash after the rename must not leave a name without its content
        if os.name == "posix":
            with suppress(OSError):  # of a new file, and where a disk knows no permissions
                shutil.copymode(target, part)
        os.replace(part, target)
    except OSError as error:
        # a full disk names nothing, or what was copied; and by its random name nobody knows the part
        if error.filename is None or str(part) in (str(error.filename), str(error.filename2)):
            error.filename, error.filename2 = str(path), None
        raise
    finally:
        with suppress(OSError):  # of a disk that is read-only: what was raised before says so by the name of the file
            part.unlink(missing_ok=True)
    if os.name == "posix":  # elsewhere a folder cannot be opened
        _to_disk(target.parent)


def encoded_name(name: str, where: Path) -> bytes:
    """The name of a file as the system has it. Raises ``DataError``, of the file ``where`` it was found, for letters
    that the encoding of the locale lacks."""
    try:
        return os.fsencode(name)
    except UnicodeEncodeError:
        problem = f'no file can be called "{name}" in a locale whose names are {sys.getfilesystemencoding()}'
        raise DataError(where, problem, "set PYTHONUTF8=1, or LC_ALL=C.UTF-8") from None


def written_file(path: Path) -> Path:
    """The file that a new content under this name is for: where ``path`` is a symbolic link, that to which it leads.

    That need not be there yet. Raises ``OSError`` for links in a circle, and for pipes and devices, whose place a file
    would take.
    """
    file = Path(os.path.realpath(path)) if path.is_symlink() else path
    if file.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    if file.exists() and not (file.is_file() or file.is_dir()):
        raise OSError(errno.EINVAL, "not a regular file", str(path))
    return file


def require_place(path: Path) -> None:
    """Raise ``DataError`` where ``replacing`` could not write a file, which makes its folder: said before long work."""
    with writing(path):
        folder = written_file(path).parent
        made_in = () if path.is_symlink() else folder.parents  # no folder is made where a link leads
        there = next((place for place in (folder, *made_in) if os.path.lexists(place)), folder)
        with TemporaryFile(dir=there):
            pass


def _to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def remove_parts(folder: Path, below: bool = True) -> None:
    """Remove what killed processes left in a folder, and ``below`` it; nobody may be writing there."""
    for part in folder.rglob(f".*{PART}") if below else folder.glob(f".*{PART}"):
        part.unlink(missing_ok=True)


def is_empty(folder: Path) -> bool:
    """Whether a folder holds nothing, or only what a process keeps there while it writes, or a file manager always."""
    return all(path.name in (LOCK, *LITTER) or path.name.endswith(PART) for path in folder.iterdir())


def parse_json(text: str) -> Any:
    """``json.loads``. Raises ``ValueError`` for whatever is wrong, half of a character too: no file can hold one."""
    try:
        content = json.loads(text)
    except RecursionError:
        raise ValueError("lists in lists, too deep to follow") from None
    if "\\u" in text:
        json.dumps(content, ensure_ascii=False).encode()
    return content


def read_json(path: Path, remedy: str) -> Any:
    """What a JSON file holds. Raises ``DataError`` that ends with the remedy."""
    try:
        return parse_json(path.read_text(encoding="utf-8-sig"))  # editors of Windows begin a file with a mark
    except json.JSONDecodeError as error:
        raise DataError(path, f"not valid JSON in line {error.lineno} ({error.msg})", remedy) from error
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror})", "check the path") from error
    except UnicodeDecodeError as error:
        raise DataError(path, "is not a text file", remedy) from error
    except ValueError as error:
        raise DataError(path, f"not usable as JSON ({error})", remedy) from error


def read_object(path: Path, remedy: str) -> dict[str, Any]:
    """What a JSON file holds that holds one object. Raises ``DataError`` as ``read_json`` does."""
    content = read_json(path, remedy)
    if not isinstance(content, dict):
        raise DataError(path, "is not a JSON object", remedy)
    return content


def json_text(value: Any, indent: int | None = None) -> str:
    """``json.dumps``, as all programs read it: JSON has no word for infinity, so that it is a number too large for a
    float, which Python and browsers read as infinity; and none for NaN, which becomes null."""
    text = json.dumps(value, indent=indent)
    return _STRING_OR_WORD.sub(lambda found: WORDS.get(found[0], found[0]), text)


def write_json(path: str | Path, value: Any) -> None:
    """Write a value as JSON, indented. Raises ``OSError``."""
    with replacing(path) as part:
        part.write_text(json_text(value, indent=2) + "\n", encoding="utf-8")


def write_bytes(path: Path, *parts: bytes) -> None:
    """Make ``parts`` the content of ``path``, whose folder is there, or leave all as it was. Raises ``DataError``."""
    with writing(path):
        path.parent.stat()  # a folder that is missing is a typing error: none is made
        with replacing(path) as part, part.open("xb") as file:
            file.writelines(parts)
