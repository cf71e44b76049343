"""The command ``dogsplat eval``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...render.picture_options import PictureOptions
from ...support.variants import set_variant
from ...support.wording import printable
from ..flags import DATA_HELP, MODEL_HELP, add_picture_flags, given_settings
from ..printing import metrics_line

SUMMARY = "metrics of a model on the test split"
EXAMPLES = """
Examples:
  dogsplat eval run/point_cloud.ply photos/ --downscale 2
  dogsplat eval run/point_cloud.ply photos/ --downscale 2 -o measured/   also writes pictures and metrics.json
  dogsplat eval run/point_cloud.ply photos/ --masks masks/ --color-correct
                                                       white pixels; and PSNR after colour correction
  dogsplat eval run/point_cloud.ply photos/ --align-poses
                                                       and PSNR from where each test view fits best

Use the --downscale that the model was trained with, else the numbers say little about it. Where it was
trained on OpenEXR images with a --white, use that, too: it exposes images and model.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    parser.add_argument("data", metavar="DATA", help=DATA_HELP)
    parser.add_argument("-o", "--out", type=Path, metavar="DIR", help="also write renders, error maps and metrics.json")
    parser.add_argument("--color-correct", action="store_true", help="also PSNR after each view's best colour map")
    parser.add_argument("--align-poses", action="store_true", help="also PSNR from the pose that fits each view best")
    add_picture_flags(parser, "masks", "data_on_disk")


def run(args: argparse.Namespace) -> None:
    """Metrics of a model on the test views of a data set (all views without a split); LPIPS where it is installed."""
    options = given_settings(PictureOptions, args)
    set_variant(args.variant)
    from ...datasets.masks import without_mask
    from ...measure.evaluate import mean_metrics
    from ...runs.evaluation import evaluate_model
    from ...runs.learned_views import learned_from

    views = evaluate_model(
        args.model, args.data, args.out, masks=args.masks, color_correct=args.color_correct,
        align_poses=args.align_poses, data_on_disk=args.data_on_disk, options=options,
    )  # fmt: skip
    for name, values in {**views, "mean": mean_metrics(views)}.items():
        print(f"{printable(name):24s}{metrics_line(values)}")
    for line in (*without_mask(args.masks, views), *learned_from(args.model, args.data, views)):
        print(printable(line))
