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

SUMMARY = "measure numerical errors and run time, and try extreme inputs"
EXAMPLES = """
Examples:
  dogsplat check -o checked                              built-in scenes, and stability cases
  dogsplat check run/point_cloud.ply -o checked --data photos/ --camera 0001
                                                         also a model, from a view of its data
  dogsplat check -o checked --only stability             only this part: takes a minute or two
  dogsplat check -o checked --only training --runs run_a run_b
                                                         training error against run time of two runs

work-precision measures the error of image and gradients against float64, and the run time, for several
cutoffs, tile bounds, ways to share exponentials, numbers of primitives and SH degrees, with and without DoG.
Leave the machine alone while it runs. stability tries inputs that break naive splatting code. training shows
the error of --runs over wall-clock time. DIR/check.html shows all results, and DIR/check.json has their
numbers. Stability cases with a wrong result are printed, and the exit code is 1.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, nargs="?", metavar="MODEL", help="a model to measure, too")
    parser.add_argument(
        "-o", "--out", type=Path, required=True, metavar="DIR", help="folder for check.html and check.json"
    )
    parser.add_argument(
        "--only", nargs="+", metavar="PART", help=f"parts to run, of {' '.join(PARTS)} (default: all that are possible)"
    )
    parser.add_argument("--runs", type=Path, nargs="+", default=[], metavar="RUN", help="run folders for training")
    add_view_flags(parser)
    parser.add_argument(
        "--width", type=int, default=256, metavar="N", help="width of the pictures, in pixels (default: 256)"
    )
    parser.add_argument("--rounds", type=int, default=9, metavar="N", help="timings of each setting (default: 9)")
    add_picture_flags(parser, without=UNUSED)


def run(args: argparse.Namespace) -> int:
    """Measure how far the numbers can be trusted, and what each digit costs, and write a report."""
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
