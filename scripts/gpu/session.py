"""Runs the steps one after the other within the time that there is, and keeps the report whole after each."""

from __future__ import annotations

import shlex
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from . import report
from .results import Result, last_line
from .running import Ended, Running
from .steps import PROBE, ROOT, WITHOUT_OPTIX, Step

LOG = "log.txt"


class Session:
    """``out`` gets report and log, ``work`` the output of each step. ``known``: the report so far; ``end``: by
    ``time.time()``. ``also`` goes into the environment of every step.
    """

    def __init__(self, out: Path, work: Path, end: float, known: dict[str, Any], also: dict[str, str]):
        self.report, self._out, self._work, self._end, self._also = known, out, work, end, also
        self._aside: list[tuple[Step, Running]] = []
        for folder in (out, work):
            folder.mkdir(parents=True, exist_ok=True)

    def note(self, name: str, title: str, command: str, outcome: str, seconds: float, result: Result) -> None:
        """Put a step into the report, in the place that it had there before."""
        self.report["steps"][name] = {
            "title": title, "command": command, "outcome": outcome, "seconds": seconds, "says": result.says,
            "rows": result.rows, "failed": result.failed,
        }
        print(f"{name}: {outcome}, {seconds:.1f} s: {result.says}", flush=True)
        report.write(self.report, self._out)

    def probe(self) -> bool | None:
        """Whether scenes can be loaded too; None where nothing can be computed on the GPU."""
        ended = self._start(PROBE, self._left()).wait()
        optix = ended.status == 0
        good = optix or ended.status == WITHOUT_OPTIX
        told = Result("arrays and scenes" if optix else "arrays, but no scenes: no OptiX")
        result = told if good else last_line(self._log(PROBE))
        self._record(PROBE, "passed" if good else "failed", ended, result)
        return optix if good else None

    def run(self, steps: Sequence[Step], optix: bool) -> None:
        """All of them; none takes the time that those behind it need at least."""
        if not optix:
            self._also = self._also | {"DOGSPLAT_TEST_WITHOUT_OPTIX": "1"}
        try:
            for k, step in enumerate(steps):
                if step.alone:
                    self._wait_for_those_aside()
                limit = min(step.limit, self._left() - self._kept(step, steps[k + 1 :]))
                if reason := self._obstacle(step, optix, limit):
                    self._leave_out(step, reason)
                    continue
                running = self._start(step, limit)
                if step.aside:
                    self._aside.append((step, running))
                else:
                    self._end_of(step, running.wait())
        finally:
            self._wait_for_those_aside()

    def _kept(self, step: Step, later: Sequence[Step]) -> float:
        """Seconds that are kept back for those that follow, as far as they fit behind this one."""
        kept, free = 0.0, self._left() - step.least
        for other in later:
            if kept + other.least <= free:
                kept += other.least
        return kept

    def _left(self) -> float:
        return self._end - time.time()

    def _obstacle(self, step: Step, optix: bool, limit: float) -> str:
        """Why a step cannot be run, if there is a reason."""
        if step.optix and not optix:
            return "no OptiX"
        before = self.report["steps"].get(step.after)
        if step.after and (before is None or before["outcome"] != "passed"):
            return f"{step.after} did not pass"
        return "no time left" if limit < max(step.least / 2, 1) else ""

    def _leave_out(self, step: Step, reason: str) -> None:
        self.note(step.name, step.title, shell(step), "not run", 0.0, Result(reason))

    def _start(self, step: Step, limit: float) -> Running:
        for path in step.fresh:
            path.unlink(missing_ok=True)
        return Running(step.command, self._log(step), min(limit, step.limit), self._also | step.environment)

    def _wait_for_those_aside(self) -> None:
        while self._aside:
            step, running = self._aside.pop()
            self._end_of(step, running.wait())

    def _end_of(self, step: Step, ended: Ended) -> None:
        result = step.read(self._log(step))
        if step.untold is not None and ended.status == step.untold:
            outcome = "not run"
        elif result.failed:
            outcome = "failed"
        elif ended.late:
            outcome = "stopped" if step.bounded else "timed out"
        else:
            outcome = "passed" if ended.status == 0 else "failed"
        self._record(step, outcome, ended, result)

    def _record(self, step: Step, outcome: str, ended: Ended, result: Result) -> None:
        with (self._out / LOG).open("a", encoding="utf-8") as log:
            log.write(f"### {step.name}: {shell(step)}\n### {outcome}, status {ended.status}, {ended.seconds:.1f} s\n")
            log.write(self._log(step).read_text(encoding="utf-8", errors="replace") + "\n")
        for path in step.keep:
            if path.is_file():
                shutil.copyfile(path, self._out / f"{step.name}_{path.name}")
        self.note(step.name, step.title, shell(step), outcome, ended.seconds, result)

    def _log(self, step: Step) -> Path:
        return self._work / f"{step.name.replace(' ', '_')}.log"


def shell(step: Step) -> str:
    """Its command as one would type it in the root of the repository."""
    words = ["python" if word == sys.executable else word.replace(f"{ROOT}/", "") for word in step.command]
    words = [word.replace(f"{ROOT.parent}/", "../") for word in words]
    return shlex.join([f"{name}={value}" for name, value in step.environment.items()] + words)
