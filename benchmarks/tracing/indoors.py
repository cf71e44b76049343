"""``dogpath`` in the room of scenes/still_life_indoors.xml beside the path-traced truth of the meshes.

Regions and errors are those of ``benchmarks dogpath``; ``edge`` is what lies within two pixels around the model, where
the background glows over which a model was trained. still_life.ply is the same still life as sRGB values, captured
over white in the light of another place.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from mi_dogsplat.formats.read import read_model
from scipy.ndimage import binary_dilation

from .error_table import ErrorTable
from .lit_runs import by_primitives, by_samples, contestants, parsed, parser_of
from .lit_scenes import INDOORS, INDOORS_MODEL, MODEL, ROOM, empty, loaded, of_meshes, picture
from .regions import regions

EDGE = 2  # pixels


def main(argv: list[str]) -> None:
    """Print the table."""
    parser = parser_of("indoors", __doc__, (160, 120), 2048)
    others = "models in place of its own (default: still_life.ply)"
    parser.add_argument("models", nargs="*", type=Path, default=[MODEL], help=others)
    contestants(parser)
    args = parsed(parser, argv)
    size, most = args.size, max(args.samples)
    meshes, model = of_meshes(INDOORS), loaded(INDOORS)
    shown, alone = (np.mean([picture(scene, args.truth // 8, size, 100 + k) for k in range(8)], 0)
                    for scene in (meshes, empty(INDOORS)))
    masks = regions(meshes, shown, alone, size, (*ROOM, "lamp", "window"))
    around = binary_dilation(masks["model"], iterations=EDGE) & ~masks["model"]
    table = ErrorTable(shown, {"model": masks["model"], "edge": around, **masks})
    n = read_model(INDOORS_MODEL).splats.n_splats
    by_samples(table, args, model, meshes, n)
    for path in args.models:
        other = loaded(INDOORS, path)
        count = read_model(path).splats.n_splats
        table.row(f"dogpath, {path.name}", most, count, lambda seed, other=other: picture(other, most, size, seed))
    splatted: Any = mi.load_dict({"type": "dogsplat", "surfaces": {"type": "path", "max_depth": 8}})
    table.row("dogsplat, path nested", most, n, lambda seed: picture(model, most, size, seed, splatted))
    by_primitives(table, args, INDOORS, INDOORS_MODEL)
