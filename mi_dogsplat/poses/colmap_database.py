"""pycolmap and its database: images, cameras, features and matches, in one file that survives being killed (SQLite)."""

from __future__ import annotations

import shutil
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..support.errors import DataError
from ..support.wording import file_size

MOST_FEATURES = 8192  # of an image, as COLMAP has it
IMAGE_BYTES = MOST_FEATURES * (128 + 24)  # descriptors, and key points of six float32, at most
PAIR_BYTES = MOST_FEATURES * 2 * 8  # matches, and those of them that its geometry keeps, at most
JOURNAL = 2  # SQLite writes everything twice


def pycolmap_module(gpu: bool) -> Any:
    """pycolmap, which keeps quiet. Raises ``DataError`` where a GPU is asked for and it has been built without."""
    terminate = signal.getsignal(signal.SIGTERM)
    import pycolmap  # here: of the extra "poses", and it takes half a second

    if terminate is not None and threading.current_thread() is threading.main_thread():  # others set no signals
        signal.signal(signal.SIGTERM, terminate)  # the import took it, to print a trace of C++ and end the process
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value  # what is wrong is said here, in one line
    if gpu and not pycolmap.has_cuda:
        remedy = "install one with CUDA (pip install pycolmap-cuda12), or leave --gpu out"
        raise DataError("--gpu", f"pycolmap {pycolmap.__version__} is built without CUDA", remedy)
    return pycolmap


def require_room(database: Path, n_bytes: int) -> None:
    """Raise ``DataError`` where the disk has no room for so many bytes of images or pairs more.

    COLMAP writes them in threads of its own, and ends the process with a trace where it cannot.
    """
    needed, free = JOURNAL * n_bytes, shutil.disk_usage(database.parent).free
    if free < needed:
        problem = f"its disk has {file_size(free)} left, and up to {file_size(needed)} are written next"
        raise DataError(database.parent, problem, "make room; the same command goes on")


@contextmanager
def opened(pycolmap: Any, path: Path) -> Iterator[Any]:
    """The database, closed afterwards. Raises ``DataError`` where the file is none."""
    try:
        database = pycolmap.Database.open(str(path))
    except (RuntimeError, ValueError) as error:
        raise DataError(path, "cannot be read as COLMAP's database", "remove it, and begin anew") from error
    try:
        yield database
    finally:
        database.close()
