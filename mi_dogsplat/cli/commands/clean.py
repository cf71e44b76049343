"""The command ``dogsplat clean``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...datasets.world_config import WorldConfig
from ...editing.clean_config import CleanConfig
from ...formats.table import FORMATS
from ...render.picture_options import PictureOptions
from ...support.variants import set_variant
from ..flags import MODEL_HELP, add_picture_flags, add_settings, given_settings
from ..printing import cleaned_lines, size_line

SUMMARY = "remove what a model does not need, or what you do not want"
EXAMPLES = """
Examples:
  dogsplat clean model.ply -o lean.ply                       without what no picture shows
  dogsplat clean model.ply -o object.ply --sphere 0 0 0 1.5 --connected 1 --preview clean.png
                                                             only an object; and a picture to check it
  dogsplat clean model.ply -o said.ply --up=-y --unit 0.31   only states what is up, and the unit in metres
  dogsplat clean model.ply -o lean.ply --data photos/ --seen --floaters
                                                             without what the photographs contradict
  dogsplat clean run/point_cloud.ply -o object.ply --data photos/ --masks masks/
                                                             only the object that is white in masks

Without flags this removes primitives with a NaN or an infinite number, primitives with an opacity below
1/255, DoG without effect, and slopes, curvatures, cuts, shifts and SH bands that are zero. The command prints
how many primitives each flag removes; a primitive with several reasons counts for the first. --seen changes
no training view. --masks keeps what is seen more in white than in black. --floaters compares primitives with
the surfaces that the views show (docs/clean.md). With --data, PSNR is measured before and after: look at it.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help=" ".join(FORMATS))
    add_settings(parser, CleanConfig)
    add_settings(parser, WorldConfig)
    parser.add_argument(
        "--data", metavar="DATA", help="data set for --seen, --masks and --floaters, and for PSNR before and after"
    )
    parser.add_argument("--preview", type=Path, metavar="OUT.png", help="also write a picture of before and after")
    add_picture_flags(parser)


def run(args: argparse.Namespace) -> None:
    """Remove from a model what no picture of it shows, and what you do not want."""
    config, options = given_settings(CleanConfig, args), given_settings(PictureOptions, args)
    world = given_settings(WorldConfig, args)
    if args.data or args.preview:
        set_variant(args.variant)
    from ...editing.clean import clean_model

    cleaned = clean_model(args.model, args.out, config, args.data, args.preview, options, world)
    print("\n".join(cleaned_lines(cleaned)))
    print(size_line(args.out, cleaned.n_after, args.model))
