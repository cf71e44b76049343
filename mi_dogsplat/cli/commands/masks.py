"""The command ``dogsplat masks``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...masking.masks_config import MasksConfig
from ...render.picture_options import PictureOptions
from ...support.variants import set_variant
from ..flags import MODEL_HELP, add_data, add_picture_flags, add_settings, given_settings
from ..printing import masks_lines

SUMMARY = "mask what moved, or stood in the way, while a scene was photographed"
EXAMPLES = """
Examples:
  dogsplat masks run/point_cloud.ply photos/ -o moved --downscale 4 --preview masked.png
                                              a mask for each view, and a picture of the largest masks
  dogsplat masks run/point_cloud.ply photos/ -o more --downscale 4 --masks masks/ --times 4
                                              adds to masks that you painted; masks smaller errors, too

This is for what only some photographs show and what is no part of the scene: people who walk by, a hand, a
passing car. A model shows what the photographs have in common. Where one photograph differs from the model,
and others do not differ at the same place, its mask becomes black. Masks of test views are white.
First train a small model, which learns little of what moved:
dogsplat train photos/ -o first --downscale 4 --steps 3500 --max-primitives 25000
Then find masks with it, look at them, and train with them: dogsplat train photos/ -o run --masks moved
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    add_data(parser)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="folder of masks to write")
    add_settings(parser, MasksConfig)
    parser.add_argument("--preview", type=Path, metavar="OUT.png", help="also write a picture of the largest masks")
    add_picture_flags(parser)


def run(args: argparse.Namespace) -> None:
    """Find what only single photographs show, and write masks of it for a training."""
    config, options = given_settings(MasksConfig, args), given_settings(PictureOptions, args)
    set_variant(args.variant)
    from ...masking.make import make_masks
    from ..progress import Bar

    with Bar("photograph") as bar:
        found = make_masks(args.model, args.data, args.out, config, args.preview, options, bar.show)
    print("\n".join(masks_lines(args.out, found)))
