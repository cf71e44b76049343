"""One program within a time limit: its output goes to a file, and it is asked to stop before it is stopped."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from dataclasses import dataclass
from pathlib import Path

GRACE = 10.0  # seconds to save and to say what was done, after SIGINT


@dataclass(frozen=True)
class Ended:
    """``status`` is that of the process, ``seconds`` its wall time; ``late``: it was asked to stop at its limit."""

    status: int
    seconds: float
    late: bool


class Running:
    """A program that was started; ``wait`` for its end, or leave it running meanwhile.

    At its limit it gets SIGINT, and after ``GRACE`` seconds more it is killed with all that it started.
    """

    def __init__(self, command: list[str], log: Path, limit: float, environment: dict[str, str]):
        log.parent.mkdir(parents=True, exist_ok=True)
        self._start, self._limit, self._seconds = time.monotonic(), limit, 0.0
        with log.open("wb") as file:  # a session of its own: what it starts ends with it
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT, start_new_session=True,
                env=os.environ | {"PYTHONUNBUFFERED": "1"} | environment,
            )
        self._late = False
        self._supervisor = threading.Thread(target=self._supervise, daemon=True)
        self._supervisor.start()

    def wait(self) -> Ended:
        """How it ended; if this is interrupted, the program is killed."""
        try:
            self._supervisor.join()
        finally:
            self._kill()
        return Ended(self._process.wait(), self._seconds, self._late)

    def _supervise(self) -> None:
        try:
            self._process.wait(self._limit)
        except subprocess.TimeoutExpired:
            self._late = True
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(GRACE)
            except subprocess.TimeoutExpired:
                self._kill()
                self._process.wait()
        self._seconds = time.monotonic() - self._start

    def _kill(self) -> None:
        try:
            os.killpg(self._process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
