"""Requests in, answers out: one line of JSON each, as long as the other program keeps the pipe open.

A line in: ``{"out": "frame.npz", ...}``, the rest as in ``request.py``. Lines out: ``{"share": 0.25}`` for each step
but the last, with ``"picture": "frame.npz"`` where a picture of what is done so far was written; at the end
``{"done": "frame.npz"}``, or ``{"error": "one line"}``, after which the next request is read.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..support.errors import DataError
from ..support.files import replacing
from .answer import Answerer, Arrays
from .request import FORMAT, SOURCE, read_request

PREVIEW_SECONDS = 1.0  # at least, between two pictures that are not finished


def serve(lines: Iterable[str], tell: Callable[[dict[str, Any]], None]) -> None:
    """Answer each line by calls of ``tell``. Needs a Mitsuba variant."""
    answerer = Answerer()
    for line in filter(str.strip, lines):
        try:
            _one(answerer, line, tell)
        except DataError as error:
            tell({"error": str(error)})


def lines_until_idle(stream: Iterable[str], seconds: float) -> Iterator[str]:
    """The lines of a stream until its end, or until none has come for so long."""
    waiting: queue.Queue[str | None] = queue.Queue()

    def pump() -> None:
        for line in stream:
            waiting.put(line)
        waiting.put(None)

    threading.Thread(target=pump, daemon=True).start()
    try:
        while (line := waiting.get(timeout=seconds)) is not None:
            yield line
    except queue.Empty:
        return


def _one(answerer: Answerer, line: str, tell: Callable[[dict[str, Any]], None]) -> None:
    try:
        content = json.loads(line)
    except ValueError as error:
        raise DataError(SOURCE, f"not valid JSON ({error})", FORMAT) from error
    out = Path(str(content.pop("out", ""))) if isinstance(content, dict) else Path()
    if out.suffix != ".npz":
        raise DataError(SOURCE, '"out" names no file .npz', FORMAT)
    shown = time.monotonic()
    for share, picture in answerer.answer(read_request(content)):
        said: dict[str, Any] = {"share": share}
        if picture is not None and (share == 1 or time.monotonic() - shown > PREVIEW_SECONDS):
            _write(out, picture)
            said, shown = {"share": share, "picture": str(out)}, time.monotonic()
        tell({"done": str(out)} if share == 1 else said)


def _write(out: Path, picture: Arrays) -> None:
    try:
        with replacing(out) as part, part.open("wb") as file:
            np.savez(file, **picture)  # pyright: ignore[reportArgumentType]
    except OSError as error:
        raise DataError(out, f"cannot be written ({error.strerror})", "check the folder") from error
