"""The command ``dogsplat render``."""

from __future__ import annotations

import argparse
import signal
from contextlib import AbstractContextManager, nullcontext
from dataclasses import fields
from pathlib import Path

from ...render.picture_options import PictureOptions
from ...runs.stopping import signals_to, stop_signals
from ...support.errors import DataError
from ...support.variants import set_variant
from ..flags import MODEL_HELP, add_picture_flags, add_view_flags, given_settings
from ..progress import Bar
from ..scene_flags import add_scene_flags, is_scene, require_no_scene_flags, scene_options

SUMMARY = "draw a picture of a model or Mitsuba scene"
OF_MODELS = "data", "camera", "appearance", *(field.name for field in fields(PictureOptions))
EXAMPLES = """
Examples:
  dogsplat render run/point_cloud.ply -o view.png                     a view that frames the model
  dogsplat render run/point_cloud.ply -o view.png --data photos/      the first test view of the data
  dogsplat render run/point_cloud.ply -o view.exr --data photos/ --camera 0001
                                                                      a view by its name
  dogsplat render run/point_cloud.ply -o view.png --camera camera.json
  dogsplat render run/point_cloud.ply -o view.exr --aovs depth,normal,index
                                                                      channels depth.Z, normal.X, ... index.I
  dogsplat render scene.xml -o view.exr                               a Mitsuba scene, by its first sensor
  dogsplat render scene.xml -o view.exr --spp 256                     with more samples per pixel
  dogsplat render scene.xml -o view.exr -s 1 -D radius=2              another sensor; "$radius" is 2
  dogsplat render lit.xml -o view.png --spp 16 --denoise              with few, denoised (dogpath)

A camera file holds {"w2c": 4x4 world to camera (x right, y down, z forward), "fx": pixels, "fy", "cx",
"cy", "width", "height"}; fy, cx and cy may be left out. A .png shows the colours over the background. An .exr
holds linear colour, premultiplied with alpha, and depth, or the channels that --aovs lists: depth,
median_depth, normal (in world space), index (which primitive contributes most; -1: none), count (number of
contributions), dog_share (share of DoG among them).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, metavar="MODEL_or_SCENE", help=f"{MODEL_HELP}; or a Mitsuba scene .xml")
    parser.add_argument(
        "-o", "--out", type=Path, required=True, metavar="OUT", help=".png; or .exr or .npz, with alpha and depth"
    )
    add_view_flags(parser)
    parser.add_argument("--aovs", metavar="NAMES", help="channels of an .exr besides colour and alpha (default: depth)")
    parser.add_argument(
        "--appearance", type=Path, metavar="JSON", help="appearance.json of a run: exposure and vignetting of the view"
    )
    add_scene_flags(parser)
    add_picture_flags(parser)


def run(args: argparse.Namespace) -> None:
    """Render a model from a view of a data set or from a camera file, or a Mitsuba scene as it stands."""
    options = given_settings(PictureOptions, args)
    set_variant(args.variant)
    from ...render.render_files import render_model, render_scene

    if is_scene(args.model):
        if args.aovs is not None:
            raise DataError("--aovs", "a scene names its own", 'set the property "aovs" of its integrator')
        drawn = scene_options(args, OF_MODELS)
        # what Mitsuba renders in one piece lets no handler of Python begin: signals end it at once, without a line
        drawing = signals_to(signal.SIG_DFL, *stop_signals())
        with _bar() as bar:
            on_pass = bar.show if bar else None
            render_scene(args.model, args.out, drawn.spp, on_pass, drawing, drawn.denoise, drawn.sensor, drawn.defined)
    else:
        require_no_scene_flags(args)
        render_model(args.model, args.out, args.data, args.camera, args.aovs, options, args.appearance)
    print(args.out)


def _bar() -> AbstractContextManager[Bar | None]:
    """That of samples; nothing where tqdm is not installed, which rendering does not need."""
    try:
        return Bar("sample")
    except ImportError:
        return nullcontext()
