"""Ctrl-C and SIGTERM as a request: the work goes on to the next place where it can be left, and is saved there.

So is SIGHUP, which comes where a terminal is closed or a connection to it breaks, unless it is ignored, as by nohup. It
comes from the shell and from the system, so that only the first one counts.

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

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.signal_number)  # how it goes from process to process


class StopRequest:
    """``with StopRequest() as stop``: the first of the ``stop_signals`` is kept in ``stop.signal_number`` (else 0).

    A second one acts as it did before. Outside of the main thread, where Python has no signals, none ever comes.
    """

    signal_number = 0

    def __enter__(self) -> StopRequest:
        self._signals = ExitStack()
        self._signals.enter_context(signals_to(self._keep, *stop_signals()))
        return self

    def __exit__(self, *_: object) -> None:
        self._signals.close()

    def _keep(self, number: int, frame: FrameType | None) -> None:
        self.signal_number = number
        self._signals.close()
        _ignore_more_of(number)


def stop_signals() -> tuple[signal.Signals, ...]:
    """What asks to stop: SIGINT, SIGTERM, and SIGHUP where there is one and nobody has it ignored."""
    hangup = getattr(signal, "SIGHUP", None)  # not on Windows
    if hangup is None or signal.getsignal(hangup) == signal.SIG_IGN:
        return (signal.SIGINT, signal.SIGTERM)
    return (signal.SIGINT, signal.SIGTERM, hangup)


def _ignore_more_of(number: int) -> None:
    if number == getattr(signal, "SIGHUP", None):
        signal.signal(number, signal.SIG_IGN)


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
    """Ctrl-C, SIGTERM or SIGHUP ends the work within at once: it raises ``Stopped`` with this line, or with that of
    what is within and knows better how it goes on."""
    asked = signal.SIGINT

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        asked = signal.Signals(number)
        _ignore_more_of(number)
        raise KeyboardInterrupt

    try:
        with signals_to(interrupt, *stop_signals()[1:]), interruptible():
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
