"""The command ``dogsplat info``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...support.variants import set_variant
from ..flags import MODEL_HELP

SUMMARY = "what a file is and what is wrong with it"
EXAMPLES = """
Examples:
  dogsplat info run/point_cloud.ply   counts, ranges, and primitives that are broken or wasted
  dogsplat info run/                  settings and result of a run
  dogsplat info photos/               views, split, points, and whether the cameras see the points
  dogsplat info scene.xml             splats, other shapes, light and sensors of a Mitsuba scene
  dogsplat info --features scene.xml  what its kernels need, at what cost, and what is left out of them
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("file", type=Path, metavar="FILE", help=f"{MODEL_HELP}; run folder, data set, or Mitsuba scene")
    parser.add_argument(
        "--features", action="store_true", help="what the kernels need for it, at what cost, and leave out"
    )


def run(args: argparse.Namespace) -> None:
    """Say what a file is: counts, ranges, and problems found; or what its kernels need and what they leave out."""
    if args.features or args.file.suffix == ".xml":
        set_variant("auto")  # to count operations, to render the sensors of a scene
    if args.features:
        from ...inspection.describe_features import describe_features as describe
    else:
        from ...inspection.info import describe

    print("\n".join(describe(args.file)))
