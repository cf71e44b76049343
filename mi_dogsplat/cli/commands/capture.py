"""The command ``dogsplat capture``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...datasets.capture_config import CaptureConfig
from ...support.variants import set_variant
from ...training.config import TrainConfig
from ..errors import resumable
from ..flags import add_settings, given_settings

SUMMARY = "render any Mitsuba scene into a training set"
EXAMPLES = """
Examples:
  dogsplat capture scene.xml -o data                     48 views from a hemisphere, 8 more for testing
  dogsplat capture scene.xml -o data --alpha --spp 256   transparent background, little noise
  dogsplat capture scene.xml -o data --path orbit --elevations 20 20 --views 60
                                                         one turn at a fixed height
  dogsplat capture scene.xml -o data --path sensors      from each perspective sensor of the scene
  dogsplat capture scene.xml -o data --path cameras.json --depth exr
  dogsplat capture scene.xml -o data --hdr               linear radiance, for a model that lights scenes
Then: dogsplat train data/ -o run

The scene's own integrator renders the pictures. DATA holds images/, points.ply and transforms.json (layout of
nerfstudio, OpenGL poses). cameras.json is a list of cameras, each as in a camera file (see dogsplat render
--help), and with a "name" if you like. Depth is measured along the view axis in world units, and 0 where
there is nothing. If you write it as npy, give nerfstudio --depth-unit-scale-factor 1. To continue a capture
that was stopped, give the same command again; only --points may differ.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("scene", type=Path, metavar="SCENE.xml", help="Mitsuba scene")
    parser.add_argument(
        "-o", "--out", type=Path, required=True, metavar="DATA", help="folder to write, or to continue"
    )
    add_settings(parser, CaptureConfig)
    add_settings(parser, TrainConfig, ["variant"])


def run(args: argparse.Namespace) -> None:
    """Render a Mitsuba scene from all around: photographs with exact cameras, and points to start a training from."""
    config = given_settings(CaptureConfig, args)
    set_variant(args.variant)
    from ...datasets.capture import capture as run_capture
    from ..progress import Bar

    with resumable(), Bar("view") as bar:
        run_capture(args.scene, args.out, config, bar.show)
    print(args.out)
