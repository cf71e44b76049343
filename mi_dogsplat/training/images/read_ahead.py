"""What is read from disk before it is due."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

READ_AHEAD = 4  # items that are read before they are due

Item = TypeVar("Item")


class ReadAhead(Generic[Item]):
    """Items that a thread reads, by their numbers, while others are worked on; none is kept once it is taken."""

    def __init__(self, read: Callable[[int], Item]):
        self._read, self._thread = read, ThreadPoolExecutor(1)
        self._reading: dict[int, Future[Item]] = {}

    def take(self, number: int, upcoming: Sequence[int]) -> Item:
        """An item, which may have been read already, as the first of the ``upcoming`` ones are from now on.

        Raises what reading it raises.
        """
        future = self._reading.pop(number, None)
        item = future.result() if future else self._read(number)
        for other in upcoming[:READ_AHEAD]:
            if other not in self._reading:
                self._reading[other] = self._thread.submit(self._read, other)
        return item
