"""Pictures that are made in the background: the newest that was asked for, and none of those that it overtook."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

Draw = Callable[[dict[str, Any], Callable[[], bool]], Iterator[tuple[float, np.ndarray]]]


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture [H, W, 4], and what it answers; ``tag`` is that of ``ask``. seconds: since the one before it."""

    pixels: np.ndarray
    tag: Any
    share: float
    seconds: float


class Stream:
    """A thread that draws; whoever shows pictures never waits for it.

    ``draw`` takes a request, and what tells whether it is to be left, and makes pictures of it. What it raises becomes
    ``error``, one line, until there is a picture again.
    """

    def __init__(self, draw: Draw, close: Callable[[], None] = lambda: None):
        self._draw, self._close = draw, close
        self._change = threading.Condition()
        self._asked: tuple[dict[str, Any], Any] | None = None
        self._ends = self._draws = False
        self.frame: Frame | None = None
        self.error = ""
        self.news = 0  # how many pictures and errors there were
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def ask(self, request: dict[str, Any], tag: Any) -> None:
        """Draw this as soon as possible, in place of what was asked for before."""
        with self._change:
            self._asked = request, tag
            self._change.notify()

    def busy(self) -> bool:
        """Whether pictures are on their way."""
        with self._change:
            return self._draws or self._asked is not None

    def close(self) -> None:
        """End the thread and what draws, once it has left its picture."""
        with self._change:
            self._ends = True
            self._change.notify()

    def _left(self) -> bool:
        return self._ends or self._asked is not None

    def _run(self) -> None:
        while True:
            with self._change:
                self._draws = False
                self._change.wait_for(self._left)
                if self._ends or self._asked is None:
                    break
                (request, tag), self._asked, self._draws = self._asked, None, True
            self._pictures(request, tag)
        self._close()

    def _pictures(self, request: dict[str, Any], tag: Any) -> None:
        start = time.perf_counter()
        try:
            for share, pixels in self._draw(request, self._left):
                now = time.perf_counter()
                with self._change:
                    self.frame, self.error = Frame(pixels, tag, share, now - start), ""
                    self.news += 1
                start = now
        except Exception as error:  # of whatever draws: a thread has nobody else to tell
            with self._change:
                self.error = " ".join(str(error).split()) or type(error).__name__
                self.news += 1
