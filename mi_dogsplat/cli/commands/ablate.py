"""The command ``dogsplat ablate``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...compare.names import ABLATION
from ...support.errors import DataError
from ..flags import add_data
from . import compare

SUMMARY = "measure what each part of the method contributes"
EXAMPLES = """
Examples:
  dogsplat ablate photos/ -o ablation --steps 7000 --downscale 2 --max-primitives 40000
  dogsplat ablate photos/ -o ablation --steps 7000 --downscale 2 --max-primitives 40000 --seeds 3
                                                       one more seed in the same table

3dgs is the baseline at 100 %. v1, v2, v3 and full each add a part of the paper's method. released is the
authors' code. ours is the preset of this name, and ours_gaussian is the same without DoG. Each of the others
adds something to the one before: ours_slopes colours that vary over a primitive, ours_cuts planes that cut
primitives off, ours_preconditioned preconditioned steps, ours_second_cuts a second plane for each primitive,
ours_curvatures a brightness that curves over it, and ours_shifts places that depend on the view.
All variants of a seed continue from one start, at the end of densification, and end with the same number of
steps. They are methods of dogsplat compare, and DIR is filled as by that command: DIR/comparison.html has the
table, and each variant is a run folder under DIR/DATA/seed_N/. Runs that are complete are not repeated.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    add_data(parser)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="folder to write, or to add to")
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=[0, 1, 2], metavar="N", help="random seeds (default: 0 1 2)"
    )
    variants = f"variants to train: any of {' '.join(ABLATION)} (default: all)"
    parser.add_argument("--only", nargs="+", default=list(ABLATION), metavar="NAME", help=variants)
    compare.add_training_flags(parser)


def run(args: argparse.Namespace) -> int:
    """Train variants of the method from one densified start per seed, and show what each part contributes."""
    if unknown := [name for name in args.only if name not in ABLATION]:
        raise DataError("--only", f'"{unknown[0]}" is unknown', f"use {', '.join(ABLATION)}")
    args.data, args.cluster, args.workers, args.more_targets = [args.data], None, 0, []
    status = compare.run(args)
    print((args.out / "comparison.md").read_text(encoding="utf-8"), end="")
    return status
