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

SUMMARY = "a model without what it does not need, or what you do not want"
EXAMPLES = """
Examples:
  dogsplat clean model.ply -o lean.ply                       what no picture shows leaves
  dogsplat clean model.ply -o object.ply --sphere 0 0 0 1.5 --connected 1 --preview clean.png
                                                             an object alone; and a picture to look at first
  dogsplat clean model.ply -o said.ply --up=-y --unit 0.31   says what is up, and its metres; no more
  dogsplat clean model.ply -o lean.ply --data photos/ --seen --floaters
                                                             what the photographs do not bear out
  dogsplat clean run/point_cloud.ply -o object.ply --data photos/ --masks masks/
                                                             what masks show in white, as an object

Without flags: primitives with a NaN or an infinite number, those of an opacity below 1/255, DoG without
effect, and slopes, curvatures, cuts, shifts and SH bands that are zero. What the flags take out is counted,
each primitive for the first reason that it has. --seen leaves every training view as it is. --masks keeps
what is seen in white more than in black. --floaters goes by the surfaces that the views show
(docs/clean.md): look at the PSNR before and after, which --data adds.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help=" ".join(FORMATS))
    add_settings(parser, CleanConfig)
    add_settings(parser, WorldConfig)
    parser.add_argument(
        "--data", metavar="DATA", help="data set for --seen, --masks, --floaters, and for PSNR before and after"
    )
    parser.add_argument("--preview", type=Path, metavar="OUT.png", help="also write a picture of before and after")
    add_picture_flags(parser)


def run(args: argparse.Namespace) -> None:
    """Take out of a model what no picture of it shows, which changes none, and what you do not want."""
    config, options = given_settings(CleanConfig, args), given_settings(PictureOptions, args)
    world = given_settings(WorldConfig, args)
    if args.data or args.preview:
        set_variant(args.variant)
    from ...editing.clean import clean_model

    cleaned = clean_model(args.model, args.out, config, args.data, args.preview, options, world)
    print("\n".join(cleaned_lines(cleaned)))
    print(size_line(args.out, cleaned.n_after, args.model))
