"""Ctrl-C and SIGTERM as a request: the work goes on to the next place where it can be left, and is saved there.

A program that has started this one can ask in another way, on Windows too, where its signals end a process at once.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import FrameType
from typing import Any

from ..support.errors import interruptible


class Stopped(KeyboardInterrupt):
    """A run stopped on request, with everything saved. ``str(e)`` is one line that says how it goes on.

    ``signal_number`` is what asked for it.
    """

    def __init__(self, message: str, signal_number: int):
        super().__init__(message)
        self.signal_number = signal_number


class StopRequest:
    """``with StopRequest() as stop``: the first SIGINT or SIGTERM is kept in ``stop.signal_number`` (else 0).

    A second one acts as it did before. Outside of the main thread, where Python has no signals, none ever comes.
    """

    signal_number = 0

    def __enter__(self) -> StopRequest:
        self._signals = ExitStack()
        self._signals.enter_context(signals_to(self._keep, signal.SIGINT, signal.SIGTERM))
        return self

    def __exit__(self, *_: object) -> None:
        self._signals.close()

    def _keep(self, number: int, frame: FrameType | None) -> None:
        self.signal_number = number
        self._signals.close()


def stop_when_input_ends() -> None:
    """From now on the end of standard input is SIGTERM: whoever started this process holds it open, and may be gone.

    So is an error in reading it, as of a terminal that was closed.
    """

    def follow() -> None:
        with suppress(OSError):
            while os.read(0, 1024):  # not sys.stdin.read, whose lock the interpreter wants when it ends
                pass
        signal.raise_signal(signal.SIGTERM)

    threading.Thread(target=follow, daemon=True).start()


@contextmanager
def stopped_with(line: str) -> Iterator[None]:
    """Ctrl-C or SIGTERM ends the work within at once: it raises ``Stopped`` with this line, or with that of what is
    within and knows better how it goes on."""
    asked = signal.SIGINT

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        asked = signal.Signals(number)
        raise KeyboardInterrupt

    try:
        with signals_to(interrupt, signal.SIGTERM), interruptible():
            yield
    except Stopped:
        raise
    except KeyboardInterrupt:
        raise Stopped(line, asked) from None


@contextmanager
def signals_to(handler: Any, *numbers: signal.Signals) -> Iterator[None]:
    """These signals within, as ``signal.signal`` has it. Nothing changes outside of the main thread, which has none."""
    here = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, handler) for number in numbers} if here else {}
    try:
        yield
    finally:
        for number, usual in before.items():
            signal.signal(number, usual)
