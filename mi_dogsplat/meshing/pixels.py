"""Which pixel of a view points are in, on the device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi


def pixel_of(place: Sequence[Any], lens: Sequence[Any], near: Any, size: Sequence[Any]) -> tuple[Any, Any, Any]:
    """(whether a point is in the picture, the number of its pixel by rows, 1 / z).

    Args:
        place: x, y and z in camera space.
        lens: fx, fy, cx, cy in pixels.
        near: what is nearer is not in the picture.
        size: height and width, unsigned.
    """
    (x, y, z), (fx, fy, cx, cy), (height, width) = place, lens, size
    ahead = z > near
    inverse = dr.rcp(dr.select(ahead, z, 1))
    column, line = dr.floor(dr.fma(fx * x, inverse, cx)), dr.floor(dr.fma(fy * y, inverse, cy))
    inside = ahead & (column >= 0) & (line >= 0) & (column < mi.Float(width)) & (line < mi.Float(height))
    return inside, mi.UInt32(dr.select(inside, line, 0)) * width + mi.UInt32(dr.select(inside, column, 0)), inverse
