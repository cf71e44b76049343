"""``dogsplat info`` of a data set: views, points, and whether the two agree."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..support.wording import count
from .lines import drawn, first_names, line

if TYPE_CHECKING:
    from ..datasets import Dataset

SCENE_SPP = 4  # enough to see that the sensors of a Mitsuba scene see something


def describe_dataset(path: Path) -> list[str]:
    """Views, split, points, whether cameras and points agree, and what ``world.json`` says."""
    from ..datasets import check_cameras, load_largest  # here: see ``info.py``
    from ..datasets.far_origin import far_from_origin
    from ..datasets.numbered_models import other_models
    from ..datasets.transforms import not_read
    from ..datasets.world import read_world

    dataset, factor = load_largest(path, SCENE_SPP)
    world = read_world(dataset.path).drawing
    check = check_cameras(dataset)
    smaller = f"; none at full size, only those for --downscale {factor}" if factor > 1 else ""
    lines = [
        f"{path}: data set",
        line("views", f"{len(dataset.train)} for training, {len(dataset.test)} for testing"),
        line("images", _sizes(dataset) + (", with alpha" if dataset.has_alpha else "") + smaller),
        line("names", first_names([view.name for view in dataset.views])),
        line(
            "points",
            count(check.n_points) if check.n_points else "none: training starts from random primitives",
        ),
    ]
    if check.seen is not None:
        images = "at least two images" if len(dataset.views) > 1 else "the image"
        lines.append(line("cameras", f"{check.seen:.0%} of the points are inside {images}"))
    if check.color_difference is not None:
        lines.append(line("colours", f"points and their pixels differ by {check.color_difference:.3f} (median)"))
    if check.reprojection_px is not None:
        lines.append(line("reprojection", f"{check.reprojection_px * factor:.2f} px (median) at full size"))
    lines += [line("world", drawn(world))] if world.said() else []
    lines += [line("origin", text) for text in far_from_origin(path)]
    return lines + [line("not read", text) for text in (*other_models(path), *not_read(path))]


def _sizes(dataset: Dataset) -> str:
    sizes = sorted({(view.camera.width, view.camera.height) for view in dataset.views})
    return first_names([f"{width}x{height}" for width, height in sizes])
