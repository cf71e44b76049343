"""Checkpoints: the whole state of a run in one file of plain arrays (no pickle), written whole or not at all."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..support.arrays import read_arrays, write_arrays
from ..support.errors import DataError

CHECKPOINT = Path("checkpoint") / "state.npz"  # in a run folder
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
    write_arrays(path, state)


def load_checkpoint(path: Path) -> dict[str, np.ndarray]:
    """Read what ``save_checkpoint`` wrote. Raises ``DataError`` if the file is missing or damaged."""
    try:
        return read_arrays(path)
    except FileNotFoundError:
        raise DataError(path, "there is no checkpoint", "train without --resume") from None
    except ValueError:
        raise DataError(path, "is not a readable checkpoint", "remove it, and start again") from None
