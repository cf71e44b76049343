"""A command of the package that ends by itself, as another process: how far it is, and what it complained of."""

from __future__ import annotations

import os
import re
import subprocess
import weakref
from pathlib import Path

from ..files.errors import told
from .served import RendererError, environment

SPEAKS = "dogsplat: "  # begins what the command complains about
TAIL = 4096  # bytes of a file of which the last line counts


class Task:
    """From its start to its end, which comes with that of its owner, or of Blender, at the latest."""

    def __init__(self, words: list[str], log: Path):
        """``words`` are the whole command; ``log`` is the file of what it says. Raises ``RendererError``."""
        self._log = log
        try:
            with log.open("wb") as errors:
                pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": errors}
                self._process = subprocess.Popen(words, **pipes, env=environment())
        except OSError as error:
            raise RendererError("{name} cannot be started ({reason})", name=words[0], reason=error.strerror) from error
        self.stop = weakref.finalize(self, _end, self._process)

    @property
    def works(self) -> bool:
        """Whether it is still there."""
        return self._process.poll() is None

    @property
    def share(self) -> float:
        """Of its work that is done, as its bar tells; 0 before that is there."""
        shares = re.findall(r"(\d+)%\|", _tail(self._log))
        return min(int(shares[-1]), 100) / 100 if shares else 0.0

    def wait(self) -> None:
        """Until its end."""
        self._process.wait()

    def require(self, out: Path) -> None:
        """Raises ``RendererError`` where it has not made a file: the one line that it complained of."""
        status = self._process.wait()
        if status or not out.is_file():
            line = last_line(self._log).removeprefix(SPEAKS)
            raise RendererError(line or told("exit status {status}", status=status))


def last_line(path: Path) -> str:
    """Of a file of text, such as a log."""
    lines = _tail(path).strip().splitlines()
    return lines[-1].strip() if lines else ""


def _tail(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(max(file.seek(0, os.SEEK_END) - TAIL, 0))
        return file.read().decode(errors="replace")


def _end(process: subprocess.Popen) -> None:
    if process.poll() is None:
        process.kill()
    process.wait()
