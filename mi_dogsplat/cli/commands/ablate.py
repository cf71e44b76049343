"""The command ``dogsplat ablate``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...compare.names import ABLATION
from ...support.errors import DataError
from ..flags import DATA_HELP
from . import compare

SUMMARY = "what each part of the method contributes"
EXAMPLES = """
Examples:
  dogsplat ablate photos/ -o ablation --steps 7000 --downscale 2 --max-primitives 40000
  dogsplat ablate photos/ -o ablation --steps 7000 --downscale 2 --max-primitives 40000 --seeds 3
                                                       one more seed in the same table
3dgs is the baseline at 100 %; v1, v2, v3 and full add a part of the paper's method each; released is the
authors' code; ours is the preset ours, ours_gaussian the same without DoG, ours_slopes with colours that vary
over primitives, ours_cuts with planes that cut them off, too, ours_preconditioned with preconditioned steps
as well, ours_second_cuts with a second plane for each primitive, ours_curvatures with a brightness that
curves over it, and ours_shifts with places that depend on the view. All of a seed go on from one start, at
the end of densification, and end with the same number of steps. DIR is filled as by dogsplat compare, of
which these are methods: DIR/comparison.html has the table, and each variant is a run folder under
DIR/DATA/seed_N/. What is complete is not repeated.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("data", metavar="DATA", help=DATA_HELP)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="folder to write, or to add to")
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=[0, 1, 2], metavar="N", help="random seeds (default: 0 1 2)"
    )
    variants = f"variants, of {' '.join(ABLATION)}"
    parser.add_argument("--only", nargs="+", default=list(ABLATION), metavar="NAME", help=variants)
    compare.add_training_flags(parser)


def run(args: argparse.Namespace) -> int:
    """Train the variants of the method from one densified start per seed, and tabulate what each part contributes."""
    if unknown := [name for name in args.only if name not in ABLATION]:
        raise DataError("--only", f'"{unknown[0]}" is unknown', f"use {', '.join(ABLATION)}")
    args.data, args.cluster, args.workers, args.more_targets = [args.data], None, 0, []
    status = compare.run(args)
    print((args.out / "comparison.md").read_text(encoding="utf-8"), end="")
    return status
