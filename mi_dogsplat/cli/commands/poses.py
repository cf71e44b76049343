"""The command ``dogsplat poses``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...poses.config import PosesConfig
from ..flags import add_settings, given_settings
from ..pose_search import search_poses

SUMMARY = "turn photographs, a video or a scan into a training set"
EXAMPLES = """
Examples:
  dogsplat poses pictures/ -o posed                    photographs of one scene, by a phone or a camera
  dogsplat poses walk.mp4 -o filmed                    a video: sharp frames, as many as its motion needs
  dogsplat poses pictures/ -o straight --undistort     for programs that know only pinhole cameras
  dogsplat poses pictures/ -o strong --lens OPENCV     a lens that bends straight lines strongly
  dogsplat poses raws/ -o posed --linear               raw photographs, whose light is kept as OpenEXR
  dogsplat poses around/ -o posed --lens EQUIRECTANGULAR
                                                       panoramas of 360°: six views of each
  dogsplat poses scan/ -o scanned                      a scan by Polycam, Record3D or Stray Scanner
  dogsplat poses pictures/ -o metres --scale IMG_1.jpg IMG_9.jpg 2.5
                                                       in metres: these two were taken 2.5 m apart
  dogsplat poses pictures/ -o metres --scale IMG_1.jpg:410,980 IMG_1.jpg:1630,940 0.75
                                                       or: these two points in it are 75 cm apart
Then: dogsplat train posed/ -o run

DATA becomes a COLMAP folder, which every trainer reads: images/ (turned upright, otherwise unchanged) and
sparse/0. Up is -y; it is found by the gravity that the photographs recorded, or else by how the cameras were
held. The origin is in the middle of the points. Raw photographs become JPEG, all with the same exposure;
--linear keeps their light, for models of radiance. Photographs of one device, size and focal length share a
camera, and EXIF gives its focal length. What is black in masks/, or transparent, is not matched. A scan has
poses of its own, in metres, and depth maps, which become DATA/depth for dogsplat train --depths.
At the end the command says how many images have a pose, and what to do if they are few. If it was stopped,
give the same command again, and it continues. dogsplat train does all of this by itself if its DATA are plain
images or a video. Needs the extra mi_dogsplat[poses].
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("source", type=Path, metavar="INPUT", help="a folder of images, a video, or a scan")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DATA", help="folder to write, or to continue")
    add_settings(parser, PosesConfig)


def run(args: argparse.Namespace) -> None:
    """Find the poses of photographs or of a video by structure from motion, and write a COLMAP folder."""
    config = given_settings(PosesConfig, args)
    search_poses(args.source, args.out, config)
    print(args.out)
