"""Primitives that a plane cuts off: what is left of them over the image (docs/cuts.md).

At w standard deviations along its axes the kernel of a primitive is multiplied by

    g(w) = (1 + e⁻⁴) / (1 + e^(-4 - n·w))

with a normal n in these axes: it falls from 1 to 0 across the plane n·w = -4, the steeper the longer n is, and n = 0
leaves the primitive whole. A second plane multiplies it by a g of its own. A pixel at the offset d from its centre sees
g at E[w | d], which is linear in d (``own_axes.py``). In units of log2, as exponents of kernels are:
g = (1 + 2^-L) / (1 + 2^-(L + hx dx + hy dy)). Where (hx, hy) would be longer than H, it is H long: steeper falls would
look the same but for jagged edges, and a walk may multiply its way from pixel to pixel (``walks/kept.py``).
"""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi

from ..scene.cuts import LARGEST, OFFSET, STEEPEST
from .arrays import detached

COLUMNS = 2  # of each plane: hx, hy
ROW = 3  # of the normals: by axis
LEVEL = OFFSET * math.log2(math.e)  # L
LONGEST = STEEPEST * math.log2(math.e)  # H
WHOLE = 1 / LARGEST  # 1 / (1 + 2^-L)
LOG2_LARGEST = math.log2(LARGEST)
END = 125.0  # exponents beyond ±125 are cut to this, where neither g nor its slope is more than 2^-125 from its limit


def by_plane(columns: list, count: int = COLUMNS) -> list[list]:
    """hx and hy of each plane, or what belongs to them; other columns by ``count``."""
    return [columns[k : k + count] for k in range(0, len(columns), count)]


def cut_on_screen(normals: list, per_pixel: list[tuple]) -> list:
    """hx and hy of a plane per pixel, in units of log2; [N] each.

    Args:
        normals: ``ROW`` arrays [N], zeros for a primitive that is whole.
        per_pixel: ``own_axes_per_pixel``.
    """
    hx: Any = 0
    hy: Any = 0
    for normal, (to_x, to_y) in zip(normals, per_pixel, strict=True):
        n = normal * math.log2(math.e)
        hx, hy = dr.fma(n, to_x, hx), dr.fma(n, to_y, hy)
    return [mi.Float(h) for h in _no_steeper(hx, hy)]


def _no_steeper(hx: Any, hy: Any) -> list:
    """(hx, hy), or where it is longer than ``LONGEST`` a vector of that length in its direction."""
    # whose direction is found at a size of 1 to 2: squares of normals might overflow, and those in their derivative
    larger = detached(dr.maximum(dr.maximum(dr.abs(hx), dr.abs(hy)), LONGEST / 2))
    x, y = hx / larger, hy / larger
    length = dr.sqrt(dr.maximum(dr.fma(x, x, y * y), 1))
    is_longer, to_longest = larger * length > LONGEST, LONGEST / length
    return [dr.select(is_longer, x * to_longest, hx), dr.select(is_longer, y * to_longest, hy)]
