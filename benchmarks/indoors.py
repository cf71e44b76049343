"""``dogpath`` in the room of scenes/still_life_indoors.xml beside the path-traced truth of the meshes.

Regions and errors are those of ``benchmarks dogpath``; ``edge`` is what lies within two pixels around the model, where
the background glows over which a model was trained. still_life.ply is the same still life as sRGB values, captured
over white in the light of another place.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mitsuba as mi
import numpy as np
from mi_dogsplat.editing.simplify import simplify_model
from mi_dogsplat.editing.simplify_config import SimplifyConfig
from mi_dogsplat.formats.read import read_model
from scipy.ndimage import binary_dilation

from .dogpath import regions
from .error_table import ErrorTable
from .lit_scenes import INDOORS, INDOORS_MODEL, MODEL, ROOM, empty, loaded, of_meshes, picture

EDGE = 2  # pixels


def main(argv: list[str]) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks indoors", description=__doc__)
    others = "models in place of its own (default: still_life.ply)"
    parser.add_argument("models", nargs="*", type=Path, default=[MODEL], help=others)
    parser.add_argument("--size", nargs=2, type=int, default=(160, 120), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--samples", nargs="+", type=int, default=[1, 4, 16, 64])
    parser.add_argument("--truth", type=int, default=2048, metavar="SPP")
    parser.add_argument("--primitives", nargs="*", type=int, default=[2500, 1000])
    parser.add_argument("--variant", default="llvm_ad_rgb")
    args = parser.parse_args(argv)
    mi.set_variant(args.variant)
    size, most = (args.size[0], args.size[1]), max(args.samples)
    meshes, model = of_meshes(INDOORS), loaded(INDOORS)
    shown, alone = (np.mean([picture(scene, args.truth // 8, size, 100 + k) for k in range(8)], 0)
                    for scene in (meshes, empty(INDOORS)))
    masks = regions(meshes, shown, alone, size, (*ROOM, "lamp", "window"))
    around = binary_dilation(masks["model"], iterations=EDGE) & ~masks["model"]
    table = ErrorTable(shown, {"model": masks["model"], "edge": around, **masks})
    n = read_model(INDOORS_MODEL).splats.n_splats
    for spp in args.samples:
        table.row("dogpath", spp, n, lambda seed, spp=spp: picture(model, spp, size, seed))
    for spp in args.samples:
        table.row("noise: path, meshes", spp, 0, lambda seed, spp=spp: picture(meshes, spp, size, seed))
    for path in args.models:
        other = loaded(INDOORS, path)
        count = read_model(path).splats.n_splats
        table.row(f"dogpath, {path.name}", most, count, lambda seed, other=other: picture(other, most, size, seed))
    splatted: Any = mi.load_dict({"type": "dogsplat", "surfaces": {"type": "path", "max_depth": 8}})
    table.row("dogsplat, path nested", most, n, lambda seed: picture(model, most, size, seed, splatted))
    with TemporaryDirectory() as folder:
        for count in args.primitives:
            file = Path(folder) / f"{count}.ply"
            simplify_model(INDOORS_MODEL, file, SimplifyConfig(target=str(count), steps=0))
            fewer = loaded(INDOORS, file)
            table.row("dogpath", most, count, lambda seed, fewer=fewer: picture(fewer, most, size, seed))
