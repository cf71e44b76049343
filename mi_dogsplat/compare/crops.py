"""The same detail of a test view by every method, side by side, where they differ most."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..measure.metrics import psnr
from ..report.pictures import Figure, embedded_jpeg, embedded_png, frame, read_pictures, worst_box
from ..report.run_folder import METRICS
from ..support.files import read_object
from .folders import REMEDY
from .names import seed_order

MaskOf = Callable[[str], NDArray[Any] | None]  # of a view by its name: [H, W], 0 where a pixel does not count


@dataclass(frozen=True)
class Crops:
    """Of the ``view`` whose PSNR by the method with the ``label`` is in the middle; and the files that are missing.

    ``masked``: some of its pixels do not count.
    """

    label: str
    seed: str
    view: str
    figures: Sequence[Figure]
    missing: Sequence[str]
    masked: bool = False


def crops(folder: Path, rows: dict[str, Any], mask_of: MaskOf | None = None) -> Crops | None:
    """None where fewer than two methods have a run of one seed, no figures where fewer than two have pictures of it.

    Args:
        folder: of the data set within the comparison.
        rows: "label" and "runs" by name.
        mask_of: None where all pixels of all views count.
    """
    seed = min((seed for row in rows.values() for seed in row["runs"]), key=seed_order, default="")
    names = [name for name, row in rows.items() if seed in row["runs"]]
    if len(names) < 2:
        return None
    view = _middle_view(folder / f"seed_{seed}" / names[0])
    files = {name: folder / f"seed_{seed}" / name / "test" / f"{view}.png" for name in names}
    pictures, missing = read_pictures(files | {"": files[names[0]].with_name(f"{view}_gt.png")})
    truth = pictures.pop("", None)
    pictures = {name: picture for name, picture in pictures.items() if truth and picture.size == truth.size}
    label = rows[names[0]]["label"]
    if truth is None or len(pictures) < 2:
        return Crops(label, seed, view, [], missing)
    arrays = {name: np.asarray(picture, np.float64) / 255 for name, picture in pictures.items()}
    mask = mask_of(view) if mask_of else None
    spread = np.std([np.abs(array - np.asarray(truth) / 255).mean(-1) for array in arrays.values()], axis=0)  # [H, W]
    left, top, width, height = worst_box(spread if mask is None else np.where(mask > 0, spread, 0))
    box = left, top, left + width, top + height
    counts = None if mask is None else mask[top : top + height, left : left + width]
    counts = counts if counts is not None and counts.any() else None  # of pictures that are all the same
    mark = frame((left, top, width, height), truth.size)
    figures = [
        Figure("Ground truth, whole view", embedded_jpeg(truth), truth.size, [mark]),
        Figure("Ground truth", embedded_png(truth.crop(box)), truth.size),
    ]
    part = np.asarray(truth.crop(box)) / 255
    for name, picture in pictures.items():
        detail = picture.crop(box)
        words = f"{rows[name]['label']}, {psnr(np.asarray(detail) / 255, part, counts):.2f} dB"
        figures.append(Figure(words, embedded_png(detail), truth.size))
    return Crops(label, seed, view, figures, missing, mask is not None)


def _middle_view(run: Path) -> str:
    """Name of the test view with the median PSNR."""
    views = read_object(run / METRICS, REMEDY)["views"]
    ranked = sorted(views, key=lambda name: views[name]["psnr"])
    return ranked[len(ranked) // 2]
