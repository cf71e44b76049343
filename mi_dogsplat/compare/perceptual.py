"""LPIPS of the runs of a comparison, from the pictures that they left."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..datasets.images import read_image
from ..measure.lpips import Lpips
from ..support.files import write_json

LPIPS = "lpips.json"  # in a run folder


def measure_lpips(runs: Sequence[Path], views: Sequence[str], lpips: Lpips) -> None:
    """Write the mean over the test views into each run folder. All runs are of one data set, and have one at least."""
    distances = []  # [views][runs]
    for name in views:
        truth = read_image(runs[0] / "test" / f"{name}_gt.png")
        distances.append(lpips.distances([read_image(run / "test" / f"{name}.png") for run in runs], truth))
    for run, value in zip(runs, np.mean(distances, axis=0), strict=True):
        write_json(run / LPIPS, {"lpips": float(value)})
