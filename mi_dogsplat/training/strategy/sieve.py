"""What leaves a training without being pruned: what is broken, and floaters in front of the lens.

A primitive very near to a training camera covers much of its picture, and no other view can judge it.
"""

from __future__ import annotations

import numpy as np

from ...support.errors import DataError
from ..optimizer import SplatOptimizer
from .broken import broken, drop_broken

ROWS = 65_536  # primitives at a time, which bounds the memory


def near_cameras(means: np.ndarray, positions: np.ndarray, distance: float) -> np.ndarray:
    """[N] whether a centre [N, 3] is nearer than ``distance`` to one of the camera positions [V, 3]."""
    near = np.zeros(len(means), bool)
    for start in range(0, len(means), ROWS):
        rows = means[start : start + ROWS, None].astype(np.float64)  # [R, 1, 3]
        near[start : start + ROWS] = (np.square(rows - positions).sum(axis=2) < distance**2).any(axis=1)
    return near


def leaving(optimizer: SplatOptimizer, extent: float, positions: np.ndarray, near_zone: float) -> np.ndarray:
    """[N] whether ``sieve`` would remove a primitive."""
    mask = broken(optimizer, extent)
    return mask | near_cameras(optimizer.numpy("means"), positions, near_zone) if near_zone else mask


def sieve(
    optimizer: SplatOptimizer, extent: float, positions: np.ndarray, near_zone: float
) -> tuple[np.ndarray, list[str]]:
    """Remove what is ``broken`` and, unless ``near_zone`` is 0, ``near_cameras``; the rows left, and what happened.

    Raises ``FloatingPointError`` or ``DataError`` where nothing would be left.
    """
    n, events = optimizer.n, []
    kept = drop_broken(optimizer, extent)
    if len(kept) < n:
        events.append(f"dropped {n - len(kept)} broken primitives")
    if near_zone:
        rows = drop_near_cameras(optimizer, positions, near_zone)
        if len(rows) < len(kept):
            events.append(f"dropped {len(kept) - len(rows)} primitives near cameras")
        kept = kept[rows]
    return kept, events


def drop_near_cameras(optimizer: SplatOptimizer, positions: np.ndarray, distance: float) -> np.ndarray:
    """Remove what is ``near_cameras``; returns the rows that are left. Raises ``DataError`` if none would be."""
    near = near_cameras(optimizer.numpy("means"), positions, distance)
    if near.all():
        raise DataError("--near-zone", f"every primitive is nearer than {distance:g} to a camera", "use a smaller one")
    kept = np.flatnonzero(~near)
    if len(kept) < len(near):
        optimizer.rearrange(kept, np.zeros(len(kept), bool))
    return kept
