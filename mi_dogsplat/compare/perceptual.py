"""LPIPS of the runs of a comparison, from the pictures that they left."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from ..files import write_json
from ..lpips import Lpips

LPIPS = "lpips.json"  # in a run folder


def measure_lpips(runs: Sequence[Path], views: Sequence[str], lpips: Lpips) -> None:
    """Write the mean over the test views into each run folder. All runs are of one data set."""
    distances: dict[Path, list[float]] = {run: [] for run in runs}
    for name in views:
        truth = lpips.features(_pixels(runs[0] / "test" / f"{name}_gt.png"))  # once for all: it takes half of the time
        for run in runs:
            distances[run].append(lpips.distance(lpips.features(_pixels(run / "test" / f"{name}.png")), truth))
    for run, values in distances.items():
        write_json(run / LPIPS, {"lpips": float(np.mean(values))})


def _pixels(path: Path) -> np.ndarray:
    """[H, W, 3] in 0..1."""
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), np.float32) / 255
