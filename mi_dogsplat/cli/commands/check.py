"""The command ``dogsplat check``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ...check import PARTS, UNUSED
from ...render.picture_options import PictureOptions
from ...support.variants import set_variant
from ..flags import add_picture_flags, add_view_flags, given_settings
from ..printing import say

SUMMARY = "numerics: error against float64 and run time, extreme inputs"
EXAMPLES = """
Examples:
  dogsplat check -o checked                              scenes made here, and stability cases
  dogsplat check run/point_cloud.ply -o checked --data photos/ --camera 0001
                                                         and a model, from a view of its data
  dogsplat check -o checked --only stability             a part alone: in a minute
  dogsplat check -o checked --only training --runs run_a run_b
                                                         training error against run time of two runs

work-precision: error of image and gradients against float64, and run time, over cutoffs, tile bounds, shared
exponentials, primitives kept, SH degree, DoG; leave the machine alone meanwhile. stability: inputs that break
naive splatting code. training: error against wall-clock time of --runs.
DIR/check.html shows it all, DIR/check.json holds it. A stability case that is wrong is printed; exit code 1.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, nargs="?", metavar="MODEL", help="model to measure as well")
    parser.add_argument(
        "-o", "--out", type=Path, required=True, metavar="DIR", help="folder for check.html and check.json"
    )
    parser.add_argument(
        "--only", nargs="+", metavar="PART", help=f"parts, of {' '.join(PARTS)} (default: all that can be run)"
    )
    parser.add_argument("--runs", type=Path, nargs="+", default=[], metavar="RUN", help="run folders, for training")
    add_view_flags(parser)
    parser.add_argument(
        "--width", type=int, default=256, metavar="N", help="width of the pictures, in pixels (default: 256)"
    )
    parser.add_argument("--rounds", type=int, default=9, metavar="N", help="timings of each setting (default: 9)")
    add_picture_flags(parser, without=UNUSED)


def run(args: argparse.Namespace) -> int:
    """How far the numbers can be trusted, and what each digit costs: numerics as one report."""
    options = given_settings(PictureOptions, args)
    set_variant(args.variant)
    from ...check.run import check as run_check

    seen = {"data": args.data, "camera": args.camera, "width": args.width, "options": options}
    measured = {"parts": args.only, "runs": args.runs, "rounds": args.rounds}
    report = run_check(args.out, args.model, **seen, **measured, progress=say)
    page = args.out / "check.html"
    print(page if page.exists() else page.with_suffix(".json"))
    if wrong := [row["name"] for row in report.get("stability", []) if row["verdict"] == "wrong"]:
        print(f"dogsplat: stability: {len(wrong)} wrong: {', '.join(wrong)}", file=sys.stderr)
    return 1 if wrong else 0
