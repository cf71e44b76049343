"""Folders that one process at a time writes to."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from .errors import DataError, making
from .files import LOCK


@contextmanager
def locked(folder: Path, problem: str) -> Iterator[None]:
    """The folder is ours alone, as far as all ask. Raises ``DataError`` with the ``problem`` if it is another's.

    The lock is the operating system's, on the file ``LOCK`` in the folder: it goes with the process, however that ends.
    """
    path = folder / LOCK
    lock = FileLock(path, fallback_to_soft=False)
    with making(folder):
        try:
            lock.acquire(blocking=False)
        except Timeout:
            raise DataError(folder, problem, "wait for it, stop it, or name another") from None
        except OSError as error:
            if error.errno != errno.ENOSYS:  # of a file system without locks, where nobody can tell
                raise
    try:
        yield
    finally:
        with suppress(OSError):
            if os.name == "posix":  # elsewhere nothing that is open can be removed
                path.unlink()  # whoever waits for it sees that it is gone, and makes another one
            lock.release()
