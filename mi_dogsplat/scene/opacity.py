"""Opacities from their logits, which is how models hold them; on the host."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

SMALLEST_OPACITY = 1e-6  # of a logit that is finite, where a file says 0 or 1
LARGEST_LOGIT = math.log(1 / SMALLEST_OPACITY - 1)  # of 1 less that; and of the smallest, but for its sign


def sigmoid(x: NDArray[Any]) -> NDArray[Any]:
    """Values in 0..1 of the type and shape of ``x``, accurate to full relative precision at both ends.

    Of ±∞ they are 1 and 0, of NaN NaN; nothing overflows.
    """
    e = np.exp(-np.abs(x))
    return np.where(x >= 0, np.ones_like(e), e) / (1 + e)
