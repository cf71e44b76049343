"""Floaters in front of the lens: primitives so near to a training camera that no other view can judge them."""

from __future__ import annotations

import numpy as np

from ..errors import DataError
from .optimizer import SplatOptimizer

ROWS = 65_536  # primitives at a time, which bounds the memory


def near_cameras(means: np.ndarray, positions: np.ndarray, distance: float) -> np.ndarray:
    """[N] whether a centre [N, 3] is nearer than ``distance`` to one of the camera positions [V, 3]."""
    near = np.zeros(len(means), bool)
    for start in range(0, len(means), ROWS):
        rows = means[start : start + ROWS, None].astype(np.float64)  # [R, 1, 3]
        near[start : start + ROWS] = (np.square(rows - positions).sum(axis=2) < distance**2).any(axis=1)
    return near


def drop_near_cameras(optimizer: SplatOptimizer, positions: np.ndarray, distance: float) -> np.ndarray:
    """Remove what is ``near_cameras``; returns the rows that are left. Raises ``DataError`` if none would be."""
    near = near_cameras(optimizer.numpy("means"), positions, distance)
    if near.all():
        raise DataError("--near-zone", f"every primitive is nearer than {distance:g} to a camera", "use a smaller one")
    kept = np.flatnonzero(~near)
    if len(kept) < len(near):
        optimizer.rearrange(kept, np.zeros(len(kept), bool))
    return kept
