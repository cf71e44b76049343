"""Brightness that curves over its primitive: how it does over the image, one lane per primitive (docs/curvatures.md).

At w standard deviations along its axes all channels of a primitive are brighter by ½ wᵀ Q w. A pixel at the offset d
from its centre sees that of E[w | d] = Pᵀ d (``own_axes.py``): ½ dᵀ P Q Pᵀ d = qxx dx² + qxy dx dy + qyy dy².
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from ..scene.curvatures import ENTRIES

COLUMNS = 3  # qxx, qxy, qyy
ROW = len(ENTRIES)  # of ``brightness_curvatures``


def curvatures_on_screen(curvatures: list, per_pixel: list[tuple]) -> list:
    """qxx, qxy and qyy per square pixel; [N] each.

    Args:
        curvatures: ``ROW`` arrays [N], zeros for a primitive without.
        per_pixel: ``own_axes_per_pixel``.
    """
    found: list[Any] = [0] * COLUMNS
    for (a, b), entry in zip(ENTRIES, curvatures, strict=True):
        (ax, ay), (bx, by) = per_pixel[a], per_pixel[b]
        share = 0.5 * entry if a == b else entry  # an entry beside the diagonal is there twice
        products = ax * bx, dr.fma(ax, by, ay * bx), ay * by
        found = [dr.fma(share, product, total) for product, total in zip(products, found, strict=True)]
    return [mi.Float(q) for q in found]


def curved_by(q: list, x: Any, y: Any) -> Any:
    """How much brighter a primitive is at the offset (x, y) from its centre."""
    qxx, qxy, qyy = q
    return dr.fma(dr.fma(qxx, x, qxy * y), x, qyy * y * y)


def curved_slope(q: list, x: Any, y: Any) -> tuple:
    """Its derivative by x and by y."""
    qxx, qxy, qyy = q
    return dr.fma(2 * qxx, x, qxy * y), dr.fma(2 * qyy, y, qxy * x)
