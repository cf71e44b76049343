"""The command ``dogsplat simplify``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...editing.simplify_config import SimplifyConfig
from ...formats.table import FORMATS
from ...render.picture_options import PictureOptions
from ...support.variants import set_variant
from ...training.config import TrainConfig
from ..flags import MODEL_HELP, add_settings, given_settings
from ..printing import simplified_lines, size_line

SUMMARY = "make a model smaller without photographs"
EXAMPLES = """
Examples:
  dogsplat simplify model.ply -o small.ply --target 10%       a tenth of its primitives, in minutes
  dogsplat simplify model.ply -o small.ply --target 20000 --steps 0
                                                              20,000 primitives, only merged: in seconds
  dogsplat simplify model.ply -o small.ply --target 5% --dog  with Differences of Gaussians

This works on models of any program and needs no photographs. With photographs, dogsplat prune knows better
what matters. Cameras are placed around the model, and inside of it where there is room. They tell how
much of each primitive is seen, and the merged model is fitted to what they see of the old one. PSNR is
measured from other places. The background is grey, so that no primitive hides in front of it. With
--background black or white the model is fitted for that one only.
"""

# these renders have no photographs
BEHIND = "colour behind the model: black, white or auto, which is grey; random is the same as auto (default: auto)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help=" ".join(FORMATS))
    add_settings(parser, SimplifyConfig)
    add_settings(parser, PictureOptions, ["background", "antialiased", "near_clip"], {"background": BEHIND})
    add_settings(parser, TrainConfig, ["variant"])


def run(args: argparse.Namespace) -> None:
    """Merge primitives that are near and alike until few are left, and fit these to renders of the model."""
    config, options = given_settings(SimplifyConfig, args), given_settings(PictureOptions, args)
    set_variant(args.variant)
    from ...editing.simplify import simplify_model
    from ..progress import Bar

    with Bar("step") as bar:
        simplified = simplify_model(args.model, args.out, config, options, bar.show)
    print("\n".join(simplified_lines(simplified)))
    print(size_line(args.out, simplified.n_after, args.model))
