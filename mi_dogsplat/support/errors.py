"""The one exception for bad input: it names the file, what is wrong and what to do, on one line."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .wording import printable

DAMAGED = "the file is damaged: copy or export it again"  # the remedy, of files that programs write
QUOTED = 600  # characters of a name, or of what quotes a file


class DataError(ValueError):
    """Bad input. ``str(e)`` is one printable line: ``<path>: <problem>; <remedy>``. A remedy of None is in the problem.

    The command line prints that line and exits with status 2; as a library the exception is a ``ValueError``.
    """

    def __init__(self, path: str | Path, problem: str, remedy: str | None):
        place, what = (text if len(text) <= QUOTED else text[:QUOTED] + "..." for text in (str(path), problem))
        line = " ".join(f"{place}: {what}{'' if remedy is None else f'; {remedy}'}".split())
        super().__init__(printable(line))
        self.path, self._given = Path(path), (path, problem, remedy)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self._given  # how it goes from process to process, and is copied


class Wrong(ValueError):
    """What is wrong and what to do, of a value of which the caller alone knows where it is from."""

    def __init__(self, problem: str, remedy: str):
        super().__init__(f"{problem}; {remedy}")
        self.problem, self.remedy = problem, remedy

    def at(self, place: str | Path) -> DataError:
        """The same with that place."""
        return DataError(place, self.problem, self.remedy)


@contextmanager
def interruptible() -> Iterator[None]:
    """Ctrl-C within is ``KeyboardInterrupt``, which Dr.Jit wraps in a ``RuntimeError`` where it renders, and Python in
    a ``SystemError`` where Mitsuba imports what a variant needs."""
    try:
        yield
    except (RuntimeError, SystemError) as error:
        if any(isinstance(each, KeyboardInterrupt) for each in _behind(error)):
            raise KeyboardInterrupt from error
        raise


def _behind(error: BaseException) -> list[BaseException]:
    """An error, and once each what it came from or was raised beside: Dr.Jit, where it wraps, closes circles."""
    found, ahead = [], [error]
    while ahead:
        each = ahead.pop()
        if not any(each is known for known in found):
            found.append(each)
            ahead += [other for other in (each.__context__, each.__cause__) if other is not None]
    return found


class _OnItsWay(Exception):
    """What the function of a caller raised, until the caller has it."""


@contextmanager
def undisguised(function: Any) -> Iterator[Any]:
    """A function that a caller gave, or None, to be called within: what it raises reaches the caller as it is, whatever
    was made of it on its way, such as an error of the scene or file that was at work."""
    raised: list[Exception] = []

    def called(*args: Any) -> Any:
        try:
            return function(*args)
        except Exception as error:
            raised.append(error)
            raise _OnItsWay from error  # which nobody takes for an error of a file, and adds to

    try:
        yield called if function else None
    except Exception:  # of any kind, whatever was made of it; all of them go on
        if raised:
            raise raised[-1] from None
        raise


@contextmanager
def making(folder: Path) -> Iterator[None]:
    """An ``OSError`` within is a ``DataError`` of a folder that cannot be made, or written."""
    try:
        yield
    except OSError as error:
        _require_target(folder)
        raise DataError(folder, error.strerror or str(error), "name a folder that can be written") from None


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """An ``OSError`` within is a ``DataError`` which says that ``path`` cannot be written."""
    try:
        yield
    except OSError as error:
        _require_target(path.parent)
        problem = f"cannot be written ({error.strerror or error})"
        raise DataError(path, problem, "check that the folder exists, is writable and has space") from error


def _require_target(folder: Path) -> None:
    """Raise ``DataError`` for a folder that is, or lies in, a link to what is not there: nothing can be made of it, and
    what the system says of that is that it exists."""
    for place in (folder, *folder.parents):
        if place.is_symlink() and not place.exists():
            problem = f"is a link to {os.readlink(place)}, which is not there"
            raise DataError(place, problem, "make that folder, or name another") from None


def gist(error: BaseException) -> str:
    """What went wrong first, in Mitsuba's words but without the Python traceback that it quotes."""
    known = []
    while cause := error.__cause__ or error.__context__:  # Dr.Jit wraps errors of a render in "see above"
        known.append(error)
        if any(cause is each for each in known):  # ... and may close a circle
            break
        error = cause
    lines = str(error).strip().splitlines() or [type(error).__name__]
    traceback = next((i for i, line in enumerate(lines) if "Traceback (most recent call last)" in line), None)
    if traceback is None:
        return " ".join(lines)
    return " ".join([*lines[:traceback], lines[traceback].split("Traceback")[0], lines[-1]])
