"""The command ``dogsplat serve``."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import TextIO

from ...support.errors import DataError
from ...support.variants import set_variant

SUMMARY = "make pictures for another program, such as Blender"
EXAMPLES = """
Examples:
  dogsplat serve requests.jsonl       a picture for each line of the file
  dogsplat serve --idle 600           for each line of standard input, until none has come for ten minutes

Each line is a request: {"out": "frame.npz", "model": "model.ply", "camera": {...}} or {"out": "frame.npz",
"scene": "scene.json", "samples": 64}. docs/blender_details.md lists what else a request may contain, and the
lines that come back. The command ends when its input ends.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    what = "file of requests, one per line (default: standard input)"
    parser.add_argument("requests", type=Path, nargs="?", metavar="FILE", help=what)
    parser.add_argument("--variant", default="auto", help="Mitsuba variant (default: %(default)s)")
    parser.add_argument(
        "--idle", type=float, metavar="SECONDS", help="end when no request has come for this long (default: never)"
    )


def run(args: argparse.Namespace) -> None:
    """Make the pictures that requests ask for, and answer on standard output; each is one line of JSON."""
    if args.idle is not None and not args.idle > 0:
        raise DataError("--idle", f"is {args.idle:g} seconds", "give more than 0")
    set_variant(args.variant)
    from ...requests.serve import Lines, serve

    with _answers() as answers, _input(args.requests) as lines:

        def tell(said: dict) -> None:
            print(json.dumps(said), file=answers, flush=True)

        serve(Lines(lines, args.idle), tell)


@contextmanager
def _answers() -> Iterator[TextIO]:
    """Standard output for answers alone: what Mitsuba prints goes to standard error meanwhile."""
    sys.stdout.flush()
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as answers:
        os.dup2(2, 1)
        try:
            yield answers
        finally:
            answers.flush()
            os.dup2(answers.fileno(), 1)


@contextmanager
def _input(path: Path | None) -> Iterator[TextIO]:
    if path is None:
        if isinstance(sys.stdin, TextIOWrapper):
            sys.stdin.reconfigure(encoding="utf-8", errors="replace")  # whatever the locale
        yield sys.stdin
        return
    try:
        file = path.open(encoding="utf-8", errors="replace")  # what is no text then is no request
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror})", "give requests, a line of JSON each") from error
    with file:
        yield file
