"""A folder that is filled step by step, and can be gone on with: a file in it says with which settings it was begun."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from .errors import DataError, making
from .files import LITTER, is_empty, read_object, write_json


def begin(
    file: Path, settings: dict[str, Any], kind: str, free: Sequence[str] = (), before: Mapping[str, Any] | None = None
) -> None:
    """Make the folder of ``file`` and write the settings there, or find the same ones.

    ``kind`` is what fills such a folder, a word for the error. ``free``, ``before``: see ``require_same``. Raises
    ``DataError``.
    """
    out = file.parent
    if out.exists() and not out.is_dir():
        raise DataError(out, "is a file", "name a folder for the data set")
    if file.exists():
        require_same(file, settings, free, before)
    elif out.is_dir() and not is_empty(out):
        raise DataError(out, "is a folder with other contents", f"name a new folder, or that of an earlier {kind}")
    with making(out):
        write_json(file, settings)


@contextmanager
def begun(
    file: Path, settings: dict[str, Any], kind: str, free: Sequence[str] = (), before: Mapping[str, Any] | None = None
) -> Iterator[None]:
    """``begin`` for a block that fills the folder. Where it ends with an error and has left nothing there, no settings
    remain either: what was wrong can be corrected and tried again under the same name."""
    is_new, is_made = not file.exists(), not file.parent.exists()
    try:
        begin(file, settings, kind, free, before)
        yield
    except BaseException:
        with suppress(OSError):  # what ended the block is told
            if is_new and all(path.name in (file.name, *LITTER) for path in file.parent.iterdir()):
                file.unlink(missing_ok=True)  # of a disk that was full it is not there
                if is_made:
                    file.parent.rmdir()
        raise


def require_same(
    file: Path, settings: dict[str, Any], free: Sequence[str] = (), before: Mapping[str, Any] | None = None
) -> None:
    """Raise ``DataError`` unless the folder was begun with these settings, but for those that are ``free`` to change.

    A setting whose name ends in ``_sha256`` is the digest of a file, or those of several by their names. ``before``:
    what settings were in versions that did not note them.
    """
    remedy = "remove the folder, or name another"
    before = {**(before or {}), **read_object(file, remedy)}
    changed = [name for name in settings if name not in free and before.get(name) != settings[name]]
    if changed:
        name = changed[0]
        what = f"{name} was {before.get(name)} and is {settings[name]} now"
        if name not in before:
            what = f"was begun by an earlier version, which did not note {name}"
        elif name.endswith("_sha256") and isinstance(of_files := settings[name], dict):
            was = before[name]
            other = next(one for one in (*of_files, *was) if was.get(one) != of_files.get(one))
            what = f"the file {other} has changed since it was begun"
        elif name.endswith("_sha256"):
            what = f"the file of the {name.removesuffix('_sha256')} has changed since it was begun"
        raise DataError(file.parent, what, "go on with the same settings, name another folder, or remove this one")
