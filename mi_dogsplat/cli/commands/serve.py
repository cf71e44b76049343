"""The command ``dogsplat serve``."""

from __future__ import annotations

import argparse
import json
import os
import sys

from ...support.variants import set_variant

SUMMARY = "pictures for another program, such as Blender, from one process"
EXAMPLES = """
Examples:
  dogsplat serve < requests.jsonl       a picture for each line

A line is a request, {"out": "frame.npz", "model": "model.ply", "camera": {...}} or {"out": "frame.npz",
"scene": "scene.json", "samples": 64}; what else may be in it, and the lines that come back, is in
docs/blender.md. It ends with its input.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("--variant", default="auto", help="Mitsuba variant (default: %(default)s)")
    parser.add_argument(
        "--idle", type=float, metavar="SECONDS", help="end when no request has come for so long (default: never)"
    )


def run(args: argparse.Namespace) -> None:
    """Answer requests for pictures, one line of JSON each, until standard input ends."""
    set_variant(args.variant)
    from ...requests.serve import lines_until_idle, serve

    sys.stdout.flush()
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as answers:
        os.dup2(2, 1)  # what Mitsuba prints is no answer

        def tell(said: dict) -> None:
            print(json.dumps(said), file=answers, flush=True)

        serve(lines_until_idle(sys.stdin, args.idle) if args.idle else sys.stdin, tell)
