"""The command ``dogsplat film``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...film.film_config import FilmConfig
from ...render.picture_options import PictureOptions
from ...support.variants import set_variant
from ...support.wording import counted
from ...training.config import TrainConfig
from ..flags import MODEL_HELP, OF_RUN, add_settings, given_settings
from ..scene_flags import add_scene_flags, is_scene, require_no_scene_flags, scene_options

SUMMARY = "render a model or Mitsuba scene along a camera path, as a video or pictures"
OF_MODELS = "background", "antialiased", "near_clip", "linear", "white"
EXAMPLES = """
Examples:
  dogsplat film run/ -o film.mp4                                  a path that suits the data of the run
  dogsplat film run/point_cloud.ply -o film.mp4 --seconds 6 --elevation 35 --size 1920 1080
                                                                  one turn around the model
  dogsplat film run/ -o film.mp4 --path cameras --smoothing 4     the path of the photographer, smoothed
  dogsplat film run/point_cloud.ply -o film.mp4 --path keys.json --shutter 0.5
                                                                  through key frames, with motion blur
  dogsplat film run/point_cloud.ply -o frames/                    numbered pictures from frames/0000.png on
  dogsplat film run/point_cloud.ply -o frames_exr/%04d.exr        linear colour with alpha, for compositing
  dogsplat film lit.xml -o lit.mp4 --spp 16 --denoise             a Mitsuba scene, around what its sensor sees
  dogsplat film scene.xml -o filmed/ --path keys.json -D radius=2
                                                                  through key frames; "$radius" is 2

Key frames: {"keys": [{"time": 0, "position": [3, 0, 1], "look_at": [0, 0, 0], "fov": 40}, ...],
"loop": false, "up": [0, 0, 1]}, or a list of camera files (docs/film.md). If a video is stopped, no file
remains. Numbered pictures that are complete remain, and the same command continues after them.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    what = f"{MODEL_HELP}; a run folder; or a Mitsuba scene .xml"
    parser.add_argument("model", type=Path, metavar="MODEL_RUN_or_SCENE", help=what)
    # no path, which would forget the slash at the end of a folder
    parser.add_argument("-o", "--out", required=True, metavar="OUT", help=".mp4, FOLDER/ or FOLDER/%%04d.exr")
    parser.add_argument(
        "--data", metavar="DATA", help="data set whose cameras the path follows (default: that of the run)"
    )
    add_settings(parser, FilmConfig)
    add_scene_flags(parser)
    add_settings(parser, PictureOptions, list(OF_MODELS), OF_RUN)
    add_settings(parser, TrainConfig, ["variant"])


def run(args: argparse.Namespace) -> None:
    """Render a model or Mitsuba scene along a camera path, as a video or as numbered pictures."""
    config, options = given_settings(FilmConfig, args), given_settings(PictureOptions, args)
    set_variant(args.variant)
    from ...film.make import make_film, make_scene_film
    from ..progress import Bar

    with Bar("frame") as bar:
        if is_scene(args.model):
            drawn = scene_options(args, OF_MODELS)
            made = make_scene_film(args.model, args.out, args.data, config, drawn, bar.show)
        else:
            require_no_scene_flags(args)
            made = make_film(args.model, args.out, args.data, config, options, bar.show)
    width, height = made.size
    frames = f"{counted(made.n_frames, 'frame')} of {width} x {height}, {made.n_frames / made.fps:.4g} s"
    print(f"{args.out}: {frames}; {made.path}")
