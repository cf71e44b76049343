"""The command ``dogsplat capture``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...datasets.capture_config import CaptureConfig
from ...support.variants import set_variant
from ...training.config import TrainConfig
from ..errors import resumable
from ..flags import add_settings, given_settings

SUMMARY = "any Mitsuba scene into a training set"
EXAMPLES = """
Examples:
  dogsplat capture scene.xml -o data                     48 views from a hemisphere, 8 more for testing
  dogsplat capture scene.xml -o data --alpha --spp 256   only what stands there, with little noise
  dogsplat capture scene.xml -o data --path orbit --elevations 20 20 --views 60
                                                         one turn at a height
  dogsplat capture scene.xml -o data --path sensors      each perspective sensor of the scene
  dogsplat capture scene.xml -o data --path cameras.json --depth exr
Then: dogsplat train data/ -o run

The scene's own integrator renders. DATA holds images/, points.ply and transforms.json (nerfstudio's layout,
OpenGL poses). cameras.json is a list of camera files (see dogsplat render --help), each with a "name" if you
like. Depth is along the view axis in world units, 0 where nothing is; with npy give nerfstudio
--depth-unit-scale-factor 1. A capture that was stopped goes on where it was with the same command; --points
alone may differ then.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("scene", type=Path, metavar="SCENE.xml", help="Mitsuba scene")
    parser.add_argument(
        "-o", "--out", type=Path, required=True, metavar="DATA", help="folder to write, or to go on with"
    )
    add_settings(parser, CaptureConfig)
    add_settings(parser, TrainConfig, ["variant"])


def run(args: argparse.Namespace) -> None:
    """Render a Mitsuba scene from all around into photographs with exact cameras, and points to start from."""
    config = given_settings(CaptureConfig, args)
    set_variant(args.variant)
    from ...datasets.capture import capture as run_capture
    from ..progress import Bar

    with resumable(), Bar("view") as bar:
        run_capture(args.scene, args.out, config, bar.show)
    print(args.out)
