"""The same part of a test view as several runs show it, and the photograph.

    python -m scripts.pictures.crops OUT.png DATA VIEW X,Y,WIDTH,HEIGHT RUN=LABEL [RUN=LABEL …]

A RUN is a run folder, whose ``test/VIEW.png`` is read. Each pixel is drawn as four.
"""

import sys
from pathlib import Path

import mi_dogsplat  # noqa: F401  before Mitsuba: it chooses the LLVM
import numpy as np
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.render.panels import labelled
from mi_dogsplat.render.picture import photograph

from .panels import write_rows

ZOOM = 2


def main(out: Path, data: Path, name: str, part: str, runs: list[str]) -> None:
    """Write the picture. The data are read in full size."""
    x, y, width, height = map(int, part.split(","))
    view = next(view for view in load_dataset(data).test if view.name == name)
    of_runs = [run.split("=") for run in runs]
    pictures = [(read_image(Path(run) / "test" / f"{name}.png"), label) for run, label in of_runs]
    panels = []
    for picture, label in [*pictures, (photograph(view, 0.0), "photograph")]:
        crop = np.kron(picture[y : y + height, x : x + width, :3], np.ones((ZOOM, ZOOM, 1)))
        panels.append(labelled(crop, label))
    write_rows(out.name, [panels], out.parent)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], sys.argv[4], sys.argv[5:])
