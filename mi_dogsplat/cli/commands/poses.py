"""The command ``dogsplat poses``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...poses.config import PosesConfig
from ..flags import add_settings, given_settings
from ..pose_search import search_poses

SUMMARY = "photographs or a video into a training set"
EXAMPLES = """
Examples:
  dogsplat poses pictures/ -o posed                    photographs of one scene, from a phone or a camera
  dogsplat poses walk.mp4 -o filmed                    a video: sharp frames, as many as its motion asks for
  dogsplat poses pictures/ -o straight --undistort     for programs that know no lenses
  dogsplat poses pictures/ -o strong --lens OPENCV     a lens that bends lines much
  dogsplat poses raws/ -o posed --linear               raw photographs, whose light is kept as OpenEXR
  dogsplat poses around/ -o posed --lens EQUIRECTANGULAR
                                                       panoramas of all directions (360°): six views of each
  dogsplat poses pictures/ -o metres --scale IMG_1.jpg IMG_9.jpg 2.5
                                                       in metres: these two were taken 2.5 m apart
  dogsplat poses pictures/ -o metres --scale IMG_1.jpg:410,980 IMG_1.jpg:1630,940 0.75
                                                       or: these two points in it are 75 cm apart
Then: dogsplat train posed/ -o run

DATA becomes a COLMAP folder: images/ (upright, else as they are) and sparse/0, which every trainer reads.
Up is -y, by what the photographs say of gravity or else as they were held, and the origin is in the middle
of the points. Raw photographs become JPEG, all in one brightness; --linear keeps their light, for models of
radiance. Photographs of one device, size and focal length share a camera; EXIF gives its focal length.
What is black in masks/, or transparent, is not matched. The end says how many images have a pose, and what
to do if they are few. Stopped, the same command goes on where it was. dogsplat train does all this by
itself when its DATA are plain images or a video. Needs the extra mi_dogsplat[poses].
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("source", type=Path, metavar="INPUT", help="folder of images, or a video")
    parser.add_argument(
        "-o", "--out", type=Path, required=True, metavar="DATA", help="folder to write, or to go on with"
    )
    add_settings(parser, PosesConfig)


def run(args: argparse.Namespace) -> None:
    """Find the poses of photographs or of a video by structure from motion, and write a COLMAP folder."""
    config = given_settings(PosesConfig, args)
    search_poses(args.source, args.out, config)
    print(args.out)
