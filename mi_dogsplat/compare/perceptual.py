"""LPIPS of the runs of a comparison, from the pictures that they left."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..datasets.dataset import View
from ..datasets.images import read_image
from ..datasets.masks import Masks
from ..measure.lpips import Lpips
from ..measure.metrics import masked
from ..support.files import write_json

LPIPS = "lpips.json"  # in a run folder


def measure_lpips(runs: Sequence[Path], views: Sequence[View], lpips: Lpips, masks: Masks | None = None) -> None:
    """Write the mean over the test views into each run folder. All runs are of one data set, and have one at least.

    Args:
        masks: pixels that they paint black do not count; of views that are black everywhere there are no pictures.
    """
    distances = []  # [views][runs]
    for view in views:
        mask = masks.of(view) if masks else None
        if mask is not None and not mask.any():
            continue
        truth = read_image(runs[0] / "test" / f"{view.name}_gt.png")
        pictures = [masked(read_image(run / "test" / f"{view.name}.png"), truth, mask) for run in runs]
        distances.append(lpips.distances(pictures, truth, mask))
    for run, value in zip(runs, np.mean(distances, axis=0), strict=True):
        write_json(run / LPIPS, {"lpips": float(value)})
