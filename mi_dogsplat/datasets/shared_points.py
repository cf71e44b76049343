"""Which points of a capture more than one of its pictures shows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..scene.cameras import Camera

LEAST_SHARED = 0.75  # of the points


def told_by_several(points: np.ndarray, cameras: Sequence[Camera]) -> np.ndarray:
    """[P] which of the points [P, 3] to keep: all, or those that fall in two pictures where too few of them do.

    Of a sky each view has a part of its own, which tells no depth. Where most points are such, readers take the poses
    for wrong (``check.py``). Where no point falls in two pictures, all are kept.
    """
    shared = _times_framed(points, cameras) >= min(2, len(cameras))
    return shared if 0 < shared.mean() < LEAST_SHARED else np.ones(len(points), bool)


def _times_framed(points: np.ndarray, cameras: Sequence[Camera]) -> np.ndarray:
    """In how many pictures each of the points [P, 3] falls, whatever stands before it, [P]."""
    times = np.zeros(len(points), np.int64)
    for camera in cameras:
        pixels, depth = camera.project(points)  # [P, 2], [P]
        times += (depth > 0) & ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=1)
    return times
