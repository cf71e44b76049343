"""Long curves made fit to be seen: their running mean, and fewer points of the same outline."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SMOOTHED_FROM = 40  # rows; below, every row is visible by itself
MAX_POINTS = 2000


def running_mean(values: NDArray[np.floating]) -> tuple[NDArray[np.floating], int]:
    """Centred mean over about 1/40 of the rows, gaps left out; and the number of rows it spans (1: none)."""
    rows = max(3, len(values) // 40 | 1) if len(values) >= SMOOTHED_FROM else 1
    present = np.isfinite(values)
    window = np.ones(rows)
    total = np.convolve(np.where(present, values, 0), window, "same")
    return total / np.maximum(np.convolve(present, window, "same"), 1), rows


def thinned(x: NDArray[np.floating], y: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """At most `MAX_POINTS` points: the lowest and highest of every run of neighbours, so no spike is lost."""
    if len(x) <= MAX_POINTS:
        return x, y
    runs = np.array_split(np.arange(len(x)), MAX_POINTS // 2)
    keep = np.unique([pick for run in runs for pick in (run[np.argmin(y[run])], run[np.argmax(y[run])])])
    return x[keep], y[keep]
