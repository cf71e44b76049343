"""A process of the package that answers requests, one line of JSON each; it lives from frame to frame."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import threading
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from ..files.errors import told

POLL_SECONDS = 0.1
QUICK_POLL_SECONDS = 0.02  # of a viewport
STRANGE = "{name}: does not answer as dogsplat serve does; update the package"


class Cancelled(Exception):
    """The user does not want the picture any more."""


class RendererError(RuntimeError):
    """No picture, and why, in one line in the language of Blender's interface; a template where there are values."""

    def __init__(self, text: str, **values: Any):
        super().__init__(told(text, **values))


class Said(NamedTuple):
    """An answer. share: of what was asked for; 1 is its end. out: the file of a picture. left: no other follows."""

    share: float
    out: str | None
    left: bool


def environment() -> dict[str, str]:
    """Of a process of the package: it writes UTF-8, which is what we read, whatever the locale is."""
    return {**os.environ, "PYTHONIOENCODING": "utf-8"}


class Served:
    """``dogsplat serve``, from its start to its end, which comes with that of Blender at the latest."""

    def __init__(self, words: list[str], name: str, log: Path):
        self._name, self._log = name, log
        try:
            with log.open("w") as output:
                pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": output}
                how = {"encoding": "utf-8", "errors": "replace", "env": environment()}
                self._process = subprocess.Popen(words, **pipes, **how)
        except OSError as error:
            raise RendererError("{name} cannot be started ({reason})", name=name, reason=error.strerror) from error
        self._lines: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=_pump, args=(self._process.stdout, self._lines), daemon=True).start()
        self.end = weakref.finalize(self, _end, self._process)

    @property
    def process_id(self) -> int:
        """As the system knows it."""
        return self._process.pid

    def lives(self) -> bool:
        """Whether it can take another request."""
        return self._process.poll() is None

    def answers(self, request: dict[str, Any], cancelled: Callable[[], bool]) -> Iterator[tuple[float, str | None]]:
        """(share that is done, file of a picture where there is one); the last share is 1.

        Raises ``Cancelled`` and ``RendererError``.
        """
        self._send(request)
        share = 0.0
        while share < 1:
            if cancelled():
                raise Cancelled
            said = self._next()
            if said is None:
                continue
            share = said.share
            yield share, said.out

    def pictures(self, request: dict[str, Any], left: Callable[[], bool]) -> Iterator[tuple[float, str]]:
        """(share that is done, its file) of a viewport, until the last, or until it is ``left`` and that is answered.

        Raises ``RendererError``.
        """
        self._send(request)
        stopped = False
        while True:
            if not stopped and left():
                self._send({"stop": True})
                stopped = True
            said = self._next(QUICK_POLL_SECONDS)
            if said is None:
                continue
            if said.left:
                return
            if said.out is None:
                raise RendererError(STRANGE, name=self._name)
            yield said.share, said.out
            if said.share >= 1:
                return

    def _send(self, line: dict[str, Any]) -> None:
        try:
            assert self._process.stdin
            self._process.stdin.write(json.dumps(line) + "\n")
            self._process.stdin.flush()
        except OSError:
            raise RendererError(f"{self._name}: {self._last_words()}") from None

    def _next(self, seconds: float = POLL_SECONDS) -> Said | None:
        """What it said, None if it said nothing for so long."""
        try:
            return self._said(self._lines.get(timeout=seconds))
        except queue.Empty:
            return None

    def _said(self, line: str | None) -> Said:
        if line is None:
            raise RendererError(f"{self._name}: {self._last_words()}")
        try:
            said = json.loads(line)
            if "error" in said:
                raise RendererError(f"{self._name}: {said['error']}")
            left, out = "left" in said, said.get("done", said.get("picture"))
            if not isinstance(out, str | None):
                raise TypeError
            return Said(1.0 if left or "done" in said else float(said["share"]), out, left)
        except (ValueError, TypeError, KeyError, AttributeError):
            raise RendererError(STRANGE, name=self._name) from None

    def _last_words(self) -> str:
        status = self._process.wait()
        lines = self._log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1] if lines else told("exit status {status}", status=status)


def _pump(stream: Any, lines: queue.Queue) -> None:
    """Its lines, and None at the end."""
    for line in stream:
        lines.put(line)
    lines.put(None)
    stream.close()


def _end(process: subprocess.Popen) -> None:
    if process.poll() is None:
        process.kill()
    process.wait()
    if process.stdin:
        try:
            process.stdin.close()
        except OSError:
            pass  # what was not read any more
