"""The command ``dogsplat mesh``."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...formats.usd_files import NAMES as USD_NAMES
from ...meshing.mesh_config import MeshConfig
from ...render.picture_options import NEAR, PictureOptions
from ...support.variants import set_variant
from ...support.wording import counted, printable
from ...training.config import TrainConfig
from ..flags import MODEL_HELP, add_settings, given_settings

NAMES = (".ply", ".obj", ".glb", ".gltf", *USD_NAMES)
SUMMARY = "write the surface of a model as triangles"
EXAMPLES = """
Examples:
  dogsplat mesh model.ply -o surface.ply                      from views around the model and inside of it
  dogsplat mesh model.ply -o surface.ply --data photos/       from its training views
  dogsplat mesh model.ply -o surface.obj --voxel 0.02 --connected 1
                                                              only its largest part, in another resolution
  dogsplat mesh model.ply -o surface.glb --faces 20000        few triangles; upright and in metres, if the
                                                              model states its up axis and unit
  dogsplat mesh model.ply -o surface.glb --faces 20000 --texture 1024
                                                              with a texture, for games and web pages
  dogsplat mesh model.ply -o surface.glb --faces 20000 --texture 2048 --data photos/ --photographs
                                                              the texture is painted from the photographs

A mesh does what splats cannot do: a ball rolls over it, and in another renderer a shadow falls on it. Depth
pictures of the model are fused into a signed distance, and marching cubes turn that into triangles. The mesh
has the coordinates of the model; in glTF and OpenUSD it is upright and in metres. Its vertices have colours,
or it has a texture.
"""

OF_FILE = "(default: as the file says; without --data a hundredth of the radius of the model if that is less)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Give its parser what it is called with."""
    parser.add_argument("model", type=Path, metavar="MODEL", help=MODEL_HELP)
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT", help=" ".join(NAMES))
    add_settings(parser, MeshConfig)
    parser.add_argument("--data", metavar="DATA", help="data set whose training views are fused")
    add_settings(parser, PictureOptions, ["downscale", "antialiased", "near_clip"], {"near_clip": f"{NEAR} {OF_FILE}"})
    add_settings(parser, TrainConfig, ["variant"])


def run(args: argparse.Namespace) -> None:
    """Find the surface that pictures of a model show, and write it as a mesh."""
    config, options = given_settings(MeshConfig, args), given_settings(PictureOptions, args)
    set_variant(args.variant)
    from ...meshing.make import make_mesh
    from ..progress import Bar

    with Bar("view") as bar:
        made = make_mesh(args.model, args.out, config, args.data, options, bar.show)
    for line in made.notes:
        print(printable(line))
    views = counted(made.n_views, "view")
    print(f"{args.out}: {counted(made.n_faces, 'triangle')} from {views}; a voxel is {made.voxel:.4g}")
