"""Checkpoints: the whole state of a run in one file of plain arrays (no pickle), written whole or not at all."""

from __future__ import annotations

import math
import re
import struct
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..errors import DataError
from ..files import replacing

# of the format .npy, version 1.0: numbers, truth values and texts in rows
ARRAY_HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..{'descr': '([<|][biufU]\d{1,7})', "
    rb"'fortran_order': False, 'shape': \(([\d, ]{0,40})\), } *\n",
    re.DOTALL,
)
SHARE = 0.02  # of the time, at most, goes into checkpoints


class Checkpoints:
    """The checkpoints of a run, one every ``seconds``; more rarely where that would take a ``SHARE`` of the time."""

    def __init__(self, path: Path, seconds: float):
        self.path, self.seconds = path, seconds
        self._rest(0.0)

    def _rest(self, cost: float) -> None:
        self.next = time.monotonic() + max(self.seconds, cost / SHARE)

    def due(self) -> bool:
        """Whether it is time for one."""
        return time.monotonic() >= self.next

    def save(self, state: Callable[[], dict[str, np.ndarray]]) -> None:
        """Take the state and write it."""
        start = time.monotonic()
        save_checkpoint(self.path, state())
        self._rest(time.monotonic() - start)


def save_checkpoint(path: Path, state: dict[str, np.ndarray]) -> None:
    """Write arrays by name; an earlier checkpoint stays in place until this one is complete."""
    with replacing(path) as part, open(part, "wb") as file:
        np.savez(file, **state)  # type: ignore[arg-type]


def load_checkpoint(path: Path) -> dict[str, np.ndarray]:
    """Read what ``save_checkpoint`` wrote. Raises ``DataError`` if the file is missing or damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            return {info.filename.removesuffix(".npy"): _read_array(archive, info) for info in archive.infolist()}
    except FileNotFoundError:
        raise DataError(path, "there is no checkpoint", "train without --resume") from None
    except (OSError, ValueError, TypeError, EOFError, RuntimeError, OverflowError, struct.error, zipfile.BadZipFile):
        raise DataError(path, "is not a readable checkpoint", "train without --resume") from None


def _read_array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """A member of the file. Raises ``ValueError`` for what ``save_checkpoint`` does not write.

    ``np.load`` would allocate whatever size the header of an array names, unpack what is compressed, and evaluate text.
    """
    if info.compress_type != zipfile.ZIP_STORED:
        raise ValueError("compressed")
    data = archive.read(info)  # checks the sum
    header = ARRAY_HEADER.match(data)
    if not header:
        raise ValueError("no header of an array")
    dtype, shape = np.dtype(header[1].decode()), [int(n) for n in header[2].replace(b",", b" ").split()]
    if len(data) - header.end() != dtype.itemsize * math.prod(shape):
        raise ValueError("the size is not that of the header")
    return np.frombuffer(data, dtype, offset=header.end()).reshape(shape)
