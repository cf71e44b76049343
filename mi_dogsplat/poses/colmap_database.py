"""pycolmap and its database: images, cameras, features and matches, in one file that survives being killed (SQLite)."""

from __future__ import annotations

import math
import shutil
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..support.errors import DataError
from ..support.wording import file_size

MOST_FEATURES = 8192  # of an image, as COLMAP has it
JOURNAL = 2  # SQLite writes everything twice
IMAGE_BYTES = JOURNAL * MOST_FEATURES * (128 + 24)  # descriptors, and key points of six float32, at most
PAIR_BYTES = JOURNAL * MOST_FEATURES * 2 * 8  # matches, and those of them that its geometry keeps, at most
EMPTY_BYTES = 128 << 10  # a database of nothing, and what SQLite keeps beside one that is open


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


def require_room(file: Path, n_bytes: int) -> None:
    """Raise ``DataError`` where so many bytes more find no room: on the disk, or in the file by its limit of size.

    COLMAP ends the process with a trace where its threads cannot write, and leaves a model cut short without a word.
    """
    needed, free = file_size(n_bytes), shutil.disk_usage(file.parent).free
    if free < n_bytes:
        problem = f"its disk has {file_size(free)} left, and up to {needed} are written next"
        raise DataError(file.parent, problem, "make room; the same command goes on")
    most = _largest_file()
    if most < (file.stat().st_size if file.exists() else 0) + n_bytes:
        problem = f"file too large: {file_size(most)} are allowed (ulimit -f), and up to {needed} are written next"
        raise DataError(file, problem, "raise that limit; the same command goes on")


def _largest_file() -> float:
    """Bytes that a file of this process may have."""
    if sys.platform == "win32":
        return math.inf
    import resource  # not on Windows

    most = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return math.inf if most == resource.RLIM_INFINITY else most


@contextmanager
def opened(pycolmap: Any, path: Path) -> Iterator[Any]:
    """The database, closed afterwards. Raises ``DataError`` where the file is none, or cannot be written."""
    try:
        database = pycolmap.Database.open(str(path))
    except (RuntimeError, ValueError) as error:  # which does not say why
        require_room(path, EMPTY_BYTES)
        raise DataError(path, "cannot be read as COLMAP's database", "remove it, and start again") from error
    try:
        yield database
    finally:
        database.close()
