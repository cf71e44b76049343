"""Checkpoints: the whole state of a run in one file of plain arrays (no pickle), written whole or not at all."""

from __future__ import annotations

import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..errors import DataError
from ..files import replacing

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
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise DataError(path, "there is no checkpoint", "train without --resume") from None
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error):
        raise DataError(path, "is not a readable checkpoint", "train without --resume") from None
