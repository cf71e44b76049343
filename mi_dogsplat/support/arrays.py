"""Files of arrays, NumPy's .npy and, by names, .npz, of which only plain data are read: no pickle, no surprises."""

from __future__ import annotations

import math
import re
import struct
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .files import replacing

# of the format .npy, version 1.0: numbers, truth values and texts in rows
HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..{'descr': '([<|][biufU]\d{1,7})', "
    rb"'fortran_order': False, 'shape': \(([\d, ]{0,40})\), } *\n",
    re.DOTALL,
)


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write them by name; a file that was there stays until this one is complete."""
    with replacing(path) as part, open(part, "wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read what ``write_arrays`` wrote. Raises ``FileNotFoundError``, or ``ValueError`` for whatever else is wrong."""
    with _opened(path) as archive:
        return {info.filename.removesuffix(".npy"): _read_array(archive, info) for info in archive.infolist()}


def read_array(path: Path, name: str) -> np.ndarray:
    """One of them, without the others. Raises ``KeyError`` if there is none of this name, and what ``read_arrays``
    raises."""
    with _opened(path) as archive:
        return _read_array(archive, archive.getinfo(f"{name}.npy"))


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except FileNotFoundError:
        raise
    except (OSError, TypeError, EOFError, RuntimeError, OverflowError, struct.error, zipfile.BadZipFile) as error:
        raise ValueError(str(error)) from None


def _read_array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """A member of the file. Raises ``ValueError`` for what ``write_arrays`` does not write."""
    if info.compress_type != zipfile.ZIP_STORED:
        raise ValueError("compressed")
    return array_of(archive.read(info))  # which checks the sum


def array_of(data: bytes) -> np.ndarray:
    """The array in the bytes of a file .npy, row by row. Raises ``ValueError`` for what is no plain data.

    ``np.load`` would allocate whatever size the header of an array names, unpack what is compressed, and evaluate text.
    """
    header = HEADER.match(data)
    if not header:
        raise ValueError("no header of an array")
    try:
        dtype = np.dtype(header[1].decode())
    except TypeError as error:
        raise ValueError(str(error)) from None
    shape = [int(n) for n in header[2].replace(b",", b" ").split()]
    if len(data) - header.end() != dtype.itemsize * math.prod(shape):
        raise ValueError("the size is not that of the header")
    return np.frombuffer(data, dtype, offset=header.end()).reshape(shape)
