"""Do the cameras see the points? Catches poses in the wrong convention before hours of training on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..support.errors import DataError
from .dataset import Dataset, View

MAX_POINTS = 20_000  # a stride keeps the check well below the time of reading the images


@dataclass(frozen=True)
class CameraCheck:
    """Agreement of cameras, points and images; None where the data cannot tell.

    ``in_front``, ``inside``: mean fraction over the views of points with positive depth, and of those that
    also fall inside the image; over the points a view observes where known, else over all. ``seen``: fraction
    of points inside at least two images (of one, where there is only one): near 1 for any real
    reconstruction, even where each view has most points behind it. ``color_difference``: median over
    point-pixel pairs of the mean absolute difference of the channels, in 0..1. ``reprojection_px``: median
    distance from the observed pixels.
    """

    n_points: int
    in_front: float | None
    inside: float | None
    seen: float | None
    color_difference: float | None
    reprojection_px: float | None


def check_cameras(dataset: Dataset, with_colors: bool = True) -> CameraCheck:
    """Project the sparse points into every view and compare; ``with_colors`` looks at the images, too, and raises
    ``DataError`` for one that cannot be read."""
    n_points = len(dataset.points)
    if n_points == 0:
        if with_colors:  # which are looked at all the same
            _color_differences(dataset, [(np.zeros((0, 2)), np.zeros(0, np.int64))] * len(dataset.views))
        return CameraCheck(0, None, None, None, None, None)
    sample = np.arange(0, n_points, -(-n_points // MAX_POINTS))  # [S] rows of points
    n_seen = np.zeros(n_points, np.int64)
    in_front, inside, shown, errors = [], [], [], []
    for view in dataset.views:
        observed = dataset.observations.get(view.name)
        rows = sample if observed is None else observed.points  # [Q]
        pixels, depth = view.camera.project(dataset.points[rows])  # [Q, 2], [Q]
        front = depth > 0
        size = (view.camera.width, view.camera.height)
        visible = front & (pixels >= 0).all(axis=1) & (pixels < size).all(axis=1)  # [Q]
        in_front.append(front.mean())
        inside.append(visible.mean())
        n_seen[rows[visible]] += 1
        if observed is not None:
            errors.append(np.linalg.norm(pixels - observed.pixels, axis=1)[front])
        shown.append((pixels[visible], rows[visible]))
    candidates = np.arange(n_points) if dataset.observations else sample
    return CameraCheck(
        n_points,
        float(np.mean(in_front)),
        float(np.mean(inside)),
        float((n_seen[candidates] >= min(2, len(dataset.views))).mean()),
        _median(_color_differences(dataset, shown) if with_colors else []),
        _median(errors),
    )


def require_plausible(dataset: Dataset, convention: str) -> CameraCheck:
    """``check_cameras``; raises ``DataError``, which names the expected ``convention``, where less than half of it
    holds.

    Without known observations a camera may rightly have most points behind it (a room seen from its middle),
    so the test is then that half of the points are *seen*; with them, that half of the observed points lie in
    front.
    """
    check = check_cameras(dataset, with_colors=False)  # images that stay on disk are not read for it
    share = check.in_front if dataset.observations else check.seen
    if share is not None and share < 0.5:
        what = "of the observed points lie in front of" if dataset.observations else "of the points are seen by"
        raise DataError(dataset.path, f"only {share:.0%} {what} the cameras", f"check the convention: {convention}")
    return check


def _color_differences(dataset: Dataset, shown: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """``_differences_in`` each view, of the points that it shows: their pixels [V, 2] and rows [V].

    Images that stay on disk are read meanwhile, as many at a time as the memory allows.
    """
    from ..support.pipeline import pipelined
    from .view_images import BYTES_READ  # here: photographs need the extra "train"

    def of_view(pair: tuple[View, tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        view, (pixels, rows) = pair
        return _differences_in(view.image, pixels, dataset.point_colors[rows])

    largest = max(view.camera.width * view.camera.height for view in dataset.views)
    return pipelined(of_view, zip(dataset.views, shown, strict=True), BYTES_READ * largest)


def _differences_in(image: np.ndarray, pixels: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Mean absolute differences of the channels between ``image`` [H, W, 3 or 4] at ``pixels`` [V, 2] and the colours
    ``expected`` [V, 3] there; of opaque pixels alone."""
    column, line = pixels.astype(np.int64).T
    color = image[line, column]  # [V, 3 or 4]
    if image.shape[2] == 4:
        opaque = color[:, 3] > 0.5
        color, expected = color[opaque, :3] / color[opaque, 3:], expected[opaque]
    return np.abs(color - expected).mean(axis=1)


def _median(parts: list[np.ndarray]) -> float | None:
    values = np.concatenate(parts) if parts else np.zeros(0)
    return float(np.median(values)) if len(values) else None
