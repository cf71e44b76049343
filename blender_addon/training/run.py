"""``dogsplat train`` as a process, which outlives no Blender: how far it is, how it ended, and how it is stopped."""

from __future__ import annotations

import json
import os
import subprocess
import weakref
from pathlib import Path

from ..engine.served import RendererError

LOG, HISTORY, METRICS, CONFIG, MODEL = "training.log", "history.jsonl", "metrics.json", "config.json", "point_cloud.ply"
PATIENCE = 20.0  # seconds for a training that is asked to stop, which finishes its step and saves a checkpoint
TAIL = 4096  # bytes of a file of which the last line counts


class TrainingRun:
    """A training from its start to its end."""

    def __init__(self, words: list[str], data: Path, folder: Path, flags: dict[str, str], resume: bool):
        """``words`` start the package; ``flags`` are settings of ``dogsplat train``. Raises ``RendererError``."""
        self.folder, self.steps, self._log = folder, int(flags["steps"]), folder.parent / LOG
        command = [*words, "train", str(data), "-o", str(folder), *(["--resume"] if resume else [])]
        command += [word for name, value in flags.items() for word in (f"--{name}", value)]
        if not resume:
            (folder / HISTORY).unlink(missing_ok=True)  # whose last row is not of this training
        try:
            with self._log.open("wb") as log:
                pipes = {"stdin": subprocess.DEVNULL, "stdout": log, "stderr": subprocess.STDOUT}
                self._process = subprocess.Popen(command, **pipes, env={**os.environ, "PYTHONUNBUFFERED": "1"})
        except OSError as error:
            name = " ".join(words)
            raise RendererError("{name} cannot be started ({reason})", name=name, reason=error.strerror) from error
        self.stop = weakref.finalize(self, _stop, self._process)

    @property
    def step(self) -> int:
        """The latest one that is known; 0 before the first."""
        try:
            return int(json.loads(_last_line(self.folder / HISTORY))["step"])
        except (OSError, ValueError, KeyError, TypeError):
            return 0

    @property
    def works(self) -> bool:
        """Whether it is still there."""
        return self._process.poll() is None

    def wait(self) -> None:
        """Until its end."""
        self._process.wait()

    def require_result(self) -> Path:
        """The model, after the end. Raises ``RendererError``: in one line what the training complained of."""
        if self._process.poll() == 0 and (self.folder / MODEL).is_file():
            return self.folder / MODEL
        line = _last_line(self._log).removeprefix("dogsplat: ")
        if line:
            raise RendererError(line)
        problem = "the training ended with status {status}; see {log}"
        raise RendererError(problem, status=self._process.poll(), log=self._log)


def can_go_on(folder: Path) -> bool:
    """Whether a training was stopped in this run folder."""
    return (folder / CONFIG).is_file() and not (folder / METRICS).is_file()


def _last_line(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(max(file.seek(0, os.SEEK_END) - TAIL, 0))
        lines = file.read().decode(errors="replace").strip().splitlines()
    return lines[-1].strip() if lines else ""


def _stop(process: subprocess.Popen) -> None:
    """As Ctrl-C does: a checkpoint is saved first, if there is time for it."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
    process.wait()
