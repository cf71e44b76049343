"""Folders that one process at a time writes to."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, SoftFileLock, Timeout

from .errors import DataError
from .files import LOCK


@contextmanager
def locked(folder: Path, problem: str) -> Iterator[None]:
    """The folder is ours alone, as far as all ask. Raises ``DataError`` with the ``problem`` if it is another's.

    The lock is the operating system's, on the file ``LOCK`` in the folder: it goes with the process, however that ends.
    """
    path = folder / LOCK
    lock = FileLock(path)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        if not isinstance(lock, SoftFileLock):  # which it becomes on a file system without locks: then nobody can tell
            raise DataError(folder, problem, "wait for it, stop it, or name another") from None
    except OSError as error:
        raise DataError(folder, error.strerror or str(error), "name a folder that can be written") from None
    try:
        yield
    finally:
        with suppress(OSError):
            if os.name == "posix":  # elsewhere nothing that is open can be removed
                path.unlink()  # whoever waits for it sees that it is gone, and makes another one
            lock.release()
