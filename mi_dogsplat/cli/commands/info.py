"""The command ``dogsplat info``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...support.variants import set_variant
from ..flags import MODEL_HELP

SUMMARY = "say what a file is and what is wrong with it"
EXAMPLES = """
Examples:
  dogsplat info run/point_cloud.ply   counts, ranges, and broken or useless primitives
  dogsplat info run/                  settings and results of a run
  dogsplat info photos/               views, split, points, and whether the cameras see the points
  dogsplat info scene.xml             splats, other shapes, light and sensors of a Mitsuba scene
  dogsplat info --features scene.xml  what its kernels need, at what cost, and what they leave out
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    what = f"{MODEL_HELP}; a run folder, a data set, or a Mitsuba scene"
    parser.add_argument("file", type=Path, metavar="FILE", help=what)
    parser.add_argument(
        "--features", action="store_true", help="say what its kernels need, at what cost, and what they leave out"
    )


def run(args: argparse.Namespace) -> None:
    """Say what a file is, with counts, ranges and problems; or what its kernels need and what they leave out."""
    if args.features or args.file.suffix == ".xml":
        set_variant("auto")  # to count operations, to render the sensors of a scene
    if args.features:
        from ...inspection.describe_features import describe_features as describe
    else:
        from ...inspection.info import describe

    print("\n".join(describe(args.file)))
