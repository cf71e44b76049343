"""How good a picture may be while a view moves: pixels and splats for a time, found from the times of pictures before.

There is no clock in here: times are in seconds of any clock.
"""

from __future__ import annotations

import math
from typing import NamedTuple

REST = 0.25  # seconds without another view, until everything is due, with every engine
TARGET = 0.06  # seconds for a picture while the view moves: 10 a second with what Blender needs besides
SPARE = 0.5  # of it: below, the next better level is tried, which takes less than twice as long


class Level(NamedTuple):
    """pixels: share along each axis. splats: share, the most important first."""

    pixels: float = 1.0
    splats: float = 1.0


LEVELS = (
    Level(), Level(0.75, 1), Level(0.5, 1), Level(0.5, 0.5), Level(0.5, 0.25), Level(0.375, 0.25), Level(0.25, 0.25),
    Level(0.25, 0.125), Level(0.25, 0.0625),
)  # fmt: skip


class Pace:
    """Of one viewport."""

    def __init__(self):
        self._level, self._moved = 0, -math.inf

    def moved(self, now: float) -> None:
        """Another view than before."""
        self._moved = now

    def rests(self, now: float) -> bool:
        """Whether the view has not moved for a while."""
        return now - self._moved >= REST

    def level(self, now: float) -> Level:
        """What is due."""
        return Level() if self.rests(now) else LEVELS[self._level]

    def took(self, level: Level, seconds: float) -> None:
        """A picture of that level was made while the view moved; those of an earlier level say nothing any more."""
        if level != LEVELS[self._level]:
            return
        if seconds > TARGET:  # two steps at most: the first picture waits for kernels
            self._level = min(self._level + (2 if seconds > 2 * TARGET else 1), len(LEVELS) - 1)
        elif seconds < SPARE * TARGET:
            self._level = max(self._level - 1, 0)
