"""Everything that needs a GPU, in a given time: tests, checks, benchmarks, memory, a training of 30,000 steps.

``scripts/gpu/run.sh`` makes the environment and starts this. Each step has a limit of its own and is logged; one that
fails does not end the others. After each, report.md, report.json and log.txt in OUT are whole. A report that is there
already keeps the steps that are not run again.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

from . import machine, report
from .results import Result
from .session import LOG, Session
from .steps import ROOT, SHARED, Setup, steps

EPILOG = "Exit status: 0 nothing failed; 1 a test or another step failed; 2 there is no GPU, or wrong use."
KEPT = 20.0  # seconds before the end in which nothing runs: a step that is late is given some to stop


def main(argv: list[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    args = _arguments(argv)
    if machine.gpu() is None:
        return machine.main()
    began = args.began or time.time()
    known = {} if args.fresh else _report_in(args.out)
    new = {"machine": machine.describe(), "versions": {name: version(name) for name in ("mitsuba", "drjit")},
           "command": args.command, "commit": _commit(), "steps": known.get("steps", {})}
    if not known:
        (args.out / LOG).unlink(missing_ok=True)
    session = Session(args.out, args.work, began + args.seconds - KEPT, new, machine.library_environment())
    if args.began:
        done = Result("from a bundle" if args.offline else "from the package index")
        session.note("install", "Environment", args.command, "passed", time.time() - began, done)
    optix = session.probe()
    if optix is not None:
        cores = int(new["machine"]["cores"])
        chosen = steps(Setup(args.work, _data(args), cores, args.offline, args.quick), optix)
        session.run([step for step in chosen if (step.name in args.only if args.only else not step.asked)], optix)
    print(f"report: {args.out / report.PAGE}")
    return 1 if report.failed(session.report) else 0


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/gpu/run.sh", description=__doc__, epilog=EPILOG)
    work = ROOT / "build" / "gpu"
    parser.add_argument("-o", "--out", type=Path, default=work, help="folder for report.md, report.json and log.txt")
    parser.add_argument("--work", type=Path, default=work / "work", help="folder for all else, such as the run")
    parser.add_argument("--seconds", type=float, default=590, help="for everything, set-up included (default: 590)")
    parser.add_argument("--only", nargs="+", metavar="STEP", help="names of the report's first table")
    parser.add_argument("--data", type=Path, help="to train on (default: fox, else the bundle's, else a captured one)")
    parser.add_argument("--fresh", action="store_true", help="forget a report that is there already")
    parser.add_argument("--quick", action="store_true", help="everything small, to try the script itself")
    parser.add_argument("--offline", action="store_true", help="install nothing")
    parser.add_argument("--bundled-data", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--began", type=float, help=argparse.SUPPRESS)
    parser.add_argument("--command", default="python -m scripts.gpu", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    args.out, args.work = args.out.resolve(), args.work.resolve()
    return args


def _data(args: argparse.Namespace) -> Path | None:
    fox = SHARED / "data" / "fox"
    return args.data or (fox if fox.is_dir() else args.bundled_data)


def _report_in(out: Path) -> dict[str, Any]:
    path = out / report.DATA
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def _commit() -> str:
    command = ["git", "describe", "--always", "--dirty"]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    except OSError:
        return "unknown"
    return done.stdout.strip() if done.returncode == 0 else "unknown"


if __name__ == "__main__":
    sys.exit(main())
