"""Regions of a view that are wrong beyond what is usual."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label, maximum

FLOOR = 0.02  # of errors that are compared: what is smaller, 5 levels of 255, says nothing
RIM = 0.4  # of the threshold: a region reaches as far as that
LEAST_AREA = 0.002  # of the picture; what is smaller is chance
MARGIN = 0.005  # of the longer side, by which a region is widened: edges are half of either


def unusual(error: NDArray, usual: NDArray, times: float) -> NDArray[np.bool_]:
    """[h, w], where a view is wrong: connected regions that pass a threshold somewhere, up to a lower one (hysteresis).

    Args:
        error: E of the view, [h, w].
        usual: the error that is usual there, [h, w].
        times: the threshold of (E + FLOOR) over (usual + FLOOR).
    """
    ratio = (error + FLOOR) / (usual + FLOOR)
    parts = np.zeros(ratio.shape, int)
    label(ratio >= RIM * times, output=parts)
    n = int(parts.max())
    numbers = np.arange(1, n + 1)
    large = np.bincount(parts.ravel(), minlength=n + 1)[1:] >= LEAST_AREA * ratio.size
    strong = np.asarray(maximum(ratio, parts, numbers)) >= times if n else np.zeros(0, bool)
    found = np.isin(parts, numbers[large & strong])
    return np.asarray(binary_dilation(found, iterations=max(1, round(MARGIN * max(ratio.shape)))), bool)
