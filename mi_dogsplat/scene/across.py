"""How much of a primitive's axes pictures from all sides see."""

from __future__ import annotations

import numpy as np

from .row_groups import Array

POWER = 1.5
"""Of 1 / s; what fits the means over views best, within .02 for all scales."""


def across_views(log_scales: Array) -> Array:
    """[C, 3] how much of each axis of primitives lies across a view, on average over pixels of views from all sides.

    In standard deviations a view in the direction v has the direction S⁻¹ Rᵀ v, and its picture of a primitive an area
    in proportion to the length of that. So flat primitives are seen along their thinnest axis, mostly. The mean square
    of the direction's part along an axis is s^-1.5 / Σ s^-1.5, nearly. What is left of 1 lies across.

    Args:
        log_scales: [C, 3]
    """
    with np.errstate(invalid="ignore"):  # of scales that are not finite
        inverse = np.exp(POWER * (log_scales.min(axis=1, keepdims=True).astype(np.float64) - log_scales))  # at most 1
    return 1 - inverse / inverse.sum(axis=1, keepdims=True)
