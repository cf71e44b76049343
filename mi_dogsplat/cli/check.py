"""The command ``dogsplat check``: which parts, of what, and the exit status."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from ..check import PARTS
from ..support.errors import DataError
from ..support.variants import set_variant


def run_check(args: argparse.Namespace) -> int:
    """How far the numbers can be trusted, and what each digit costs: numerics as one report."""
    parts = args.only or [part for part in PARTS if part != "training" or args.runs]
    _check_parts(args, parts)
    set_variant(args.variant)
    from ..check.run import check, model_to_check

    model = model_to_check(args) if args.model else None
    report = check(model, args.out, args.runs, parts, args.width, args.rounds, lambda line: print(line, flush=True))
    page = args.out / "check.html"
    print(page if page.exists() else page.with_suffix(".json"))
    if wrong := [row["name"] for row in report.get("stability", []) if row["verdict"] == "wrong"]:
        print(f"dogsplat: stability: {len(wrong)} wrong: {', '.join(wrong)}", file=sys.stderr)
    return 1 if wrong else 0


def _check_parts(args: argparse.Namespace, parts: Sequence[str]) -> None:
    """Raise ``DataError`` for parts that are unknown or lack what they need, and for what no part would use."""
    if unknown := [part for part in parts if part not in PARTS]:
        raise DataError("--only", f'"{unknown[0]}" is unknown', f"use {', '.join(PARTS)}")
    if "training" in parts and not args.runs:
        raise DataError("--only", "training has no run to read", "add --runs RUN")
    for part, flag, given in (("training", "--runs", args.runs), ("work-precision", args.model, args.model)):
        if given and part not in parts:
            raise DataError(flag, f"is for {part} alone", f"add {part} to --only, or leave it out")
    for flag, value, least in (("--width", args.width, 16), ("--rounds", args.rounds, 1)):
        if value < least:
            raise DataError(flag, f"{value} is too small", f"use at least {least}")
