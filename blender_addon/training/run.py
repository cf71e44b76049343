"""``dogsplat train`` as a process, which outlives no Blender: how far it is, how it ended, and how it is stopped."""

from __future__ import annotations

import json
import math
import subprocess
import time
import weakref
from pathlib import Path

from ..files.whole import remove
from ..package.served import RendererError, environment
from ..package.task import SPEAKS, last_line

LOG, HISTORY, METRICS, CONFIG, MODEL = "training.log", "history.jsonl", "metrics.json", "config.json", "point_cloud.ply"
CHECKPOINT = Path("checkpoint") / "state.npz"
PATIENCE = 20.0  # seconds for a training that is asked to stop, which finishes its step and saves a checkpoint


class TrainingRun:
    """A training from its start to its end."""

    def __init__(self, words: list[str], data: Path, folder: Path, flags: dict[str, str], resume: bool):
        """``words`` start the package; ``flags`` are settings of ``dogsplat train``.

        Raises ``FileError`` and ``RendererError``.
        """
        self.folder, self.steps, self._log = folder, int(flags["steps"]), folder.parent / LOG
        command = [*words, "train", str(data), "-o", str(folder), *(["--resume"] if resume else [])]
        command += ["--until-input-ends"]
        command += [word for name, value in flags.items() for word in (f"--{name}", value)]
        if not resume:
            remove(folder / HISTORY)  # whose last row is not of this training
            remove(folder / CHECKPOINT)  # which the package refuses to begin anew upon
        try:
            with self._log.open("wb") as log:
                pipes = {"stdin": subprocess.PIPE, "stdout": log, "stderr": subprocess.STDOUT}
                process = subprocess.Popen(command, **pipes, env=environment() | {"PYTHONUNBUFFERED": "1"})
        except OSError as error:
            name = " ".join(words)
            raise RendererError("{name} cannot be started ({reason})", name=name, reason=error.strerror) from error
        self._process = _Process(process)
        self.stop = weakref.finalize(self, self._process.stop)  # now; with its owner, or with Blender, at the latest

    @property
    def step(self) -> int:
        """The latest one that is known; 0 before the first."""
        try:
            return int(json.loads(last_line(self.folder / HISTORY))["step"])
        except (OSError, ValueError, KeyError, TypeError):
            return 0

    @property
    def works(self) -> bool:
        """Whether it is still there; one that was asked to stop is killed when ``PATIENCE`` is over."""
        return self._process.works()

    @property
    def is_complete(self) -> bool:
        """Whether it came to its end and has left a model."""
        return self._process.poll() == 0 and (self.folder / MODEL).is_file()

    def ask_to_stop(self) -> None:
        """At once: it finishes its step, saves a checkpoint and ends, which ``works`` tells."""
        self._process.ask()

    def wait(self) -> None:
        """Until its end."""
        self._process.wait()

    def require_result(self) -> Path:
        """The model, after the end. Raises ``RendererError``: in one line what the training complained of."""
        if self.is_complete:
            return self.folder / MODEL
        line = last_line(self._log).removeprefix(SPEAKS)
        if line:
            raise RendererError(line)
        problem = "the training ended with status {status}; see {log}"
        raise RendererError(problem, status=self._process.poll(), log=self._log)


def can_go_on(folder: Path) -> bool:
    """Whether a training was stopped in this run folder."""
    return (folder / CONFIG).is_file() and not (folder / METRICS).is_file()


class _Process:
    """A process that is asked to stop by the end of its input, which comes with that of Blender at the latest.

    A signal would do on Unix alone: what Python calls ``terminate`` ends a process of Windows before it has saved.
    """

    def __init__(self, process: subprocess.Popen):
        self._process = process
        self._end = math.inf  # time at which it is killed

    def poll(self) -> int | None:
        """Its exit status; None while it works."""
        return self._process.poll()

    def works(self) -> bool:
        """Whether it is still there. One that does not listen is killed when its time is over."""
        if self.poll() is None and time.monotonic() >= self._end:
            self._process.kill()
            self._process.wait()
        return self.poll() is None

    def ask(self) -> None:
        """As Ctrl-C does: a checkpoint is saved, if there is time for it."""
        assert self._process.stdin
        self._process.stdin.close()
        self._end = min(self._end, time.monotonic() + PATIENCE)

    def wait(self) -> None:
        """Until its end."""
        self._process.wait()

    def stop(self) -> None:
        """Ask it, and wait for its end."""
        self.ask()
        try:
            self._process.wait(max(self._end - time.monotonic(), 0.0) if self.poll() is None else None)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
