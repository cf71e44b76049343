"""Standard deviations of primitives, which models hold as their logarithms."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

SMALLEST_SCALE = 1e-30  # in place of 0, which has no logarithm: far below what float32 tells apart beside any other
SMALLEST_LOG_SCALE = math.log(SMALLEST_SCALE)
LARGEST_LOG_SCALE = math.log(np.finfo(np.float32).max)


def finite_scales(log_scales: ArrayLike) -> NDArray[np.float64]:
    """Standard deviations, of the shape of their logarithms; the largest float32 where they are beyond it.

    One primitive of a training that went wrong has such a scale, and its square and products of these have to be
    numbers, too, where models are edited.
    """
    return np.exp(np.minimum(np.asarray(log_scales, np.float64), LARGEST_LOG_SCALE))
