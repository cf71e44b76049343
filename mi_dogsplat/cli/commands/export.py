"""The command ``dogsplat export``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...datasets.world_config import WorldConfig
from ...export.export_config import ExportConfig
from ...formats.table import FORMATS
from ...render.picture_options import PictureOptions
from ...support.variants import set_variant
from ..flags import MODEL_HELP, add_picture_flags, add_settings, given_settings
from ..printing import loss_table, size_line

SUMMARY = "write a model in the format of another program"
EXAMPLES = """
Examples:
  dogsplat export run/point_cloud.ply -o model.spz                    Niantic, Babylon, Spark; small
  dogsplat export run/point_cloud.ply -o model.sog                    PlayCanvas, SuperSplat; small
  dogsplat export run/point_cloud.ply -o model.sog --small --data photos/ --downscale 2
                                                                      two fifths of that, and refined
  dogsplat export run/point_cloud.ply -o model.compressed.ply         PlayCanvas, SuperSplat; a quarter
  dogsplat export run/point_cloud.ply -o model.glb                    glTF (KHR_gaussian_splatting); lossless
  dogsplat export run/point_cloud.ply -o model.usdz                   OpenUSD: Houdini, Omniverse; lossless
  dogsplat export run/point_cloud.ply -o plain.ply --data photos/ --downscale 2
                                                                      any 3DGS viewer; measured on photographs
  dogsplat export run/point_cloud.ply -o small.compressed.ply --dog keep
                                                                      with DoG, in five bytes each
  dogsplat export run/point_cloud.ply -o model.spz --upright          up is y, whatever it was in the model
  dogsplat export model.ply -o model.glb --up=-y --unit 0.31          glTF upright and in metres
  dogsplat export run/point_cloud.ply -o model.html --data photos/ --views 0
                                                                      a web page with a viewer, to send on

MODEL may have any of these formats. Other programs know only plain Gaussians. So each DoG primitive becomes
the nearest Gaussian, or only its primary (--dog drop). A colour that varies over a primitive becomes its
mean, a primitive that a plane cuts off becomes the nearest whole one, and a place that depends on the view
becomes its mean. Files in .ply and .compressed.ply can hold all of this: --dog keep, --slopes keep, --cuts
keep, --shifts keep. To make up for what is left out, the model is refined on the photographs of --data, or
else on renders of the model, which takes 10 to 100 ms a step on a CPU (--refine 0: not at all). The file is
read back, and the loss of each stage is printed. glTF and OpenUSD are upright and in metres, if the model
states its up axis and unit, or --up and --scale do. SPZ has y up if the model has -y up. Other formats keep
the axes of the model; --upright turns and scales the model itself. A web page (.html, 0.8 MB and the model)
needs a browser but no network, and opens with the view of the first photograph of the data.
"""

def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help=" ".join((*FORMATS, ".html")))
    add_settings(parser, ExportConfig)
    parser.add_argument(
        "--data", metavar="DATA", help="data set: refine on its photographs, and measure the loss on its test views"
    )
    add_settings(parser, WorldConfig)
    add_picture_flags(parser)


def run(args: argparse.Namespace) -> None:
    """Write a model in the format of another program, without what that format cannot hold, and measure the loss."""
    config, world = given_settings(ExportConfig, args), given_settings(WorldConfig, args)
    options = given_settings(PictureOptions, args)
    set_variant(args.variant)
    from ...export.write import export_model
    from ..progress import Bar

    with Bar("step", "refining") as bar:
        exported = export_model(args.model, args.out, config, args.data, options, world, bar.show)
    for line in (*exported.left_out, *loss_table(exported)):
        print(line)
    print(size_line(args.out, exported.n_splats, args.model))
