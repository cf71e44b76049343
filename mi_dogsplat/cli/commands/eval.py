"""The command ``dogsplat eval``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...render.picture_options import PictureOptions
from ...support.variants import set_variant
from ...support.wording import printable
from ..flags import MODEL_HELP, add_data, add_picture_flags, given_settings
from ..printing import metrics_line

SUMMARY = "measure a model on the test views of its data"
EXAMPLES = """
Examples:
  dogsplat eval run/point_cloud.ply photos/ --downscale 2
  dogsplat eval run/point_cloud.ply photos/ --downscale 2 -o measured/   also write pictures and metrics.json
  dogsplat eval run/point_cloud.ply photos/ --masks masks/ --color-correct
                                                       only white pixels; also PSNR after colour correction
  dogsplat eval run/point_cloud.ply photos/ --align-poses
                                                       also PSNR from where each test view fits best

Use the --downscale with which the model was trained; otherwise the numbers say little about it. If it was
trained on OpenEXR images with a --white, use that one, too: it sets the exposure of images and model.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    add_data(parser)
    parser.add_argument("-o", "--out", type=Path, metavar="DIR", help="also write renders, error maps and metrics.json")
    corrected, aligned = "after the best colour map of each view", "from the pose that fits each view best"
    parser.add_argument("--color-correct", action="store_true", help=f"also measure PSNR {corrected}")
    parser.add_argument("--align-poses", action="store_true", help=f"also measure PSNR {aligned}")
    add_picture_flags(parser, "masks", "data_on_disk")


def run(args: argparse.Namespace) -> None:
    """Measure a model on the test views of a data set (all views if it has no split), with LPIPS if it is installed."""
    options = given_settings(PictureOptions, args)
    set_variant(args.variant)
    from ...datasets.masks import without_mask
    from ...measure.evaluate import mean_metrics
    from ...runs.evaluation import evaluate_model
    from ...runs.learned_views import learned_from
    from ...runs.masks_of_run import without_masks_of_run

    views = evaluate_model(
        args.model, args.data, args.out, masks=args.masks, color_correct=args.color_correct,
        align_poses=args.align_poses, data_on_disk=args.data_on_disk, options=options,
    )  # fmt: skip
    for name, values in {**views, "mean": mean_metrics(views)}.items():
        print(f"{printable(name):24s}{metrics_line(values)}")
    of_masks = *without_mask(args.masks, views), *without_masks_of_run(args.model, args.masks)
    for line in (*of_masks, *learned_from(args.model, args.data, views)):
        print(printable(line))
