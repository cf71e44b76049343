"""Requests in, answers out: one line of JSON each, as long as the other program keeps the pipe open.

A line in: ``{"out": "frame.npz", ...}``, the rest as in ``request.py``. Lines out: ``{"share": 0.25}`` for each step
but the last, with ``"picture": "frame.npz"`` where a picture of what is done so far was written; at the end
``{"done": "frame.npz"}``, or ``{"error": "one line"}``, after which the next request is read.

With ``"out": "frame.rgba"`` it is a picture for a viewport, as in ``view_request.py``: float32 [H, W, 4] and nothing
else. Its pictures lie in two files in turn, which the lines name: not everywhere can a file be replaced while it is
read. When another line comes, a picture of paths is left, with ``{"left": "frame.rgba"}`` at the end. Such a line may
be ``{"stop": true}``, which is no request and gets no answer.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..support.errors import DataError, writing
from ..support.files import parse_json, replacing
from ..support.variants import require_arrays
from .request import FORMAT, SOURCE, read_request
from .view_request import read_view_request

if TYPE_CHECKING:
    from .answer import Answerer, Arrays
    from .views import Views

PREVIEW_SECONDS = 1.0  # at least, between two pictures that are not finished
STOP = {"stop": True}  # a line that ends a picture for a viewport and asks for nothing


class Lines:
    """The lines of a stream until its end, or until none has come for so many seconds; they are read ahead."""

    def __init__(self, stream: Iterable[str], seconds: float | None = None):
        self._seconds = None if seconds is None or seconds > threading.TIMEOUT_MAX else seconds
        self._waiting: queue.Queue[str | None] = queue.Queue()

        def pump() -> None:
            with suppress(OSError, ValueError):  # a stream that cannot be read any more has ended
                for line in stream:
                    self._waiting.put(line)
            self._waiting.put(None)

        threading.Thread(target=pump, daemon=True).start()

    def __iter__(self) -> Iterator[str]:
        try:
            while (line := self._waiting.get(timeout=self._seconds)) is not None:
                yield line
        except queue.Empty:
            return

    def another(self) -> bool:
        """Whether the next one is there."""
        with self._waiting.mutex:
            return any(line is not None for line in self._waiting.queue)


def serve(lines: Iterable[str], tell: Callable[[dict[str, Any]], None]) -> None:
    """Answer each line by calls of ``tell``. Needs a Mitsuba variant.

    Pictures for viewports are left when another line comes if ``lines`` is ``Lines``, which knows.
    """
    require_arrays()
    from .answer import Answerer  # here: they cannot be imported before a variant is set
    from .views import Views

    answerer, views = Answerer(), Views()
    another = lines.another if isinstance(lines, Lines) else lambda: False
    for line in filter(str.strip, lines):
        try:
            content = _content(line)
            if content == STOP:
                continue
            out = Path(str(content.pop("out", ""))) if isinstance(content, dict) else Path()
            if "\0" in str(out):
                raise DataError(SOURCE, '"out" has a character that no name of a file can have', FORMAT)
            if out.suffix == ".rgba":
                _view(views, content, out, another, tell)
            elif out.suffix == ".npz":
                _whole(answerer, content, out, tell)
            else:
                raise DataError(SOURCE, '"out" names no file .npz, nor .rgba', FORMAT)
        except DataError as error:
            tell({"error": str(error)})
        except MemoryError as error:  # of one picture; the next may be smaller
            problem = f"not enough memory ({error or 'no more to be had'})"
            tell({"error": str(DataError(SOURCE, problem, "ask for fewer pixels, samples or primitives"))})


def _content(line: str) -> Any:
    try:
        return parse_json(line.removeprefix("\ufeff"))  # editors and shells of Windows begin a text with a mark
    except ValueError as error:
        raise DataError(SOURCE, f"not valid JSON ({error})", FORMAT) from error


def _view(views: Views, content: Any, out: Path, another: Callable[[], bool], tell: Callable) -> None:
    share, path = 0.0, out
    for number, (share, picture) in enumerate(views.frames(read_view_request(content), another)):
        path = out.with_stem(f"{out.stem}_{number % 2}")
        part = path.with_name(f".{path.name}")
        with writing(path):
            try:
                picture.tofile(part)
                part.replace(path)  # whoever reads the one before has it whole
            except OSError:
                part.unlink(missing_ok=True)
                raise
        if share < 1:
            tell({"share": share, "picture": str(path)})
    tell({"done" if share == 1 else "left": str(path)})


def _whole(answerer: Answerer, content: Any, out: Path, tell: Callable[[dict[str, Any]], None]) -> None:
    shown = time.monotonic()
    for share, picture in answerer.answer(read_request(content)):
        said: dict[str, Any] = {"share": share}
        if picture is not None and (share == 1 or time.monotonic() - shown > PREVIEW_SECONDS):
            _write(out, picture)
            said, shown = {"share": share, "picture": str(out)}, time.monotonic()
        tell({"done": str(out)} if share == 1 else said)


def _write(out: Path, picture: Arrays) -> None:
    with writing(out), replacing(out) as part, part.open("wb") as file:
        np.savez(file, **picture)  # pyright: ignore[reportArgumentType]
