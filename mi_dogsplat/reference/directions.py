"""Directions from a camera to centres, in float64."""

from __future__ import annotations

import numpy as np


def directions(offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors [N, 3] and lengths [N, 1] of `offsets` [N, 3]; of a centre on the camera zero, and 1."""
    lengths = np.linalg.norm(offsets, axis=1, keepdims=True)
    lengths = np.where(lengths > 0, lengths, 1)
    return offsets / lengths, lengths
