"""The command ``dogsplat view``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...render.picture_options import PictureOptions
from ...support.variants import set_variant
from ..flags import MODEL_HELP, OF_RUN, add_picture_flags, given_settings
from ..printing import say

SUMMARY = "show a model, or a run while it trains, in the browser"
EXAMPLES = """
Examples:
  dogsplat view run/point_cloud.ply                     open the address that it prints in a browser
  dogsplat view run/                                    a run while it trains: follows its checkpoints
  dogsplat view run/point_cloud.ply --data photos/ --downscale 2
                                                        shows the error against the nearest photograph
  dogsplat view run/ --host 0.0.0.0 --port 9000         for other machines, too; there is no password

Every picture is rendered by this command: small while the camera moves, in full size when it rests. The panel
switches DoG, slopes with curvatures, cuts, or shifts off. It can show only DoG or only Gaussians, differences
and errors, and it sets resolution, SH degree and background.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, metavar="MODEL_or_RUN", help=f"{MODEL_HELP}; or a run folder")
    parser.add_argument("--data", metavar="DATA", help="photographs to compare with (default: those of the run)")
    parser.add_argument("--host", default="127.0.0.1", metavar="NAME", help="address to listen on (default: 127.0.0.1)")
    parser.add_argument("--port", type=int, default=8080, metavar="N", help="port to listen on (default: 8080)")
    add_picture_flags(parser, said=OF_RUN)


def run(args: argparse.Namespace) -> None:
    """Show a model, or a run while it trains, in the browser."""
    options = given_settings(PictureOptions, args)
    set_variant(args.variant)
    from ...viewer.server import serve

    serve(args.model, args.data, args.host, args.port, options, say)
