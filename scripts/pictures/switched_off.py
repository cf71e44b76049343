"""The pictures of docs/slopes.md, cuts.md, curvatures.md and shifts.md: a part of a test view by two methods, by the
second one without what it adds, and the photograph.

    dogsplat compare ../shared/data/bonsai -o DIR --downscale 2 --steps 7000 --max-primitives 100000 \\
        --max-world-scale inf \\
        --only ours ours_slopes ours_cuts ours_preconditioned ours_second_cuts ours_curvatures \\
            ours_shifts
    python -m scripts.pictures.switched_off DIR ../shared/data/bonsai [PICTURE.png …]
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mi_dogsplat  # noqa: F401  before Mitsuba: it chooses the LLVM
import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import View
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.render.panels import labelled
from mi_dogsplat.render.picture import photograph, picture_of
from mi_dogsplat.report.run_folder import MODEL
from mi_dogsplat.scene.drawing import drawn_as
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.variants import set_variant

from .panels import write_rows

DOWNSCALE, ZOOM = 2, 2
WIDTH, HEIGHT = 180, 135  # pixels of the part


@dataclass(frozen=True)
class Sheet:
    """A picture: what the second method has and the first has not, and the left upper corner of the part."""

    methods: tuple[str, str]
    adds: str
    without: Callable[[Splats], Splats]
    view: str
    corner: tuple[int, int]  # x, y


SHEETS = {
    "slopes.png": Sheet(("ours", "ours_slopes"), "slopes", Splats.without_slopes, "DSCF5661", (220, 131)),
    "cuts.png": Sheet(("ours_slopes", "ours_cuts"), "cuts", Splats.without_cuts, "DSCF5605", (0, 0)),
    "second_cuts.png": Sheet(
        ("ours_preconditioned", "ours_second_cuts"), "second cuts", Splats.without_second_cuts, "DSCF5605", (0, 0)
    ),
    "curvatures.png": Sheet(
        ("ours_second_cuts", "ours_curvatures"), "curvatures", Splats.without_curvatures, "DSCF5605", (0, 0)
    ),
    "shifts.png": Sheet(("ours_curvatures", "ours_shifts"), "shifts", Splats.without_shifts, "DSCF5613", (123, 32)),
}


def main(comparison: Path, data: Path, names: Sequence[str] = ()) -> None:
    """Write those of these ``names``; without any, all."""
    views = {Path(view.name).stem: view for view in load_dataset(data, DOWNSCALE).test}
    for name, sheet in [(name, sheet) for name, sheet in SHEETS.items() if name in (names or SHEETS)]:
        view, folder = views[sheet.view], comparison / data.name / "seed_0"
        models = {method: read_model(folder / method / MODEL) for method in sheet.methods}
        panels = {method: drawn(model, model.splats, view) for method, model in models.items()}
        adds = models[sheet.methods[1]]
        panels[f"the same, its {sheet.adds} switched off"] = drawn(adds, sheet.without(adds.splats), view)
        panels["photograph"] = photograph(view, 0.0)
        (x, y), (height, width) = sheet.corner, (HEIGHT, WIDTH)
        parts = {text: panel[y : y + height, x : x + width] for text, panel in panels.items()}
        write_rows(name, [[labelled(enlarged(part), text) for text, part in parts.items()]])


def drawn(model: Model, splats: Splats, view: View) -> np.ndarray:
    """[H, W, 3] of sRGB values: primitives as a model's file says that they are drawn."""
    return picture_of(splats, 0.0, drawn_as(model.drawing))(view.camera).color


def enlarged(part: np.ndarray) -> np.ndarray:
    """Each pixel as a square."""
    return part.repeat(ZOOM, axis=0).repeat(ZOOM, axis=1)


if __name__ == "__main__":
    set_variant("auto")
    main(*map(Path, sys.argv[1:3]), sys.argv[3:])
