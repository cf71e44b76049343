"""Where a primitive can be met: its cutoff ellipsoid and the box around that.

Beyond its *cutoff ellipsoid* the kernels of a primitive are below the cutoff. It has the axes of the primitive, and of
a DoG primitive it is the smallest such one that holds the ellipsoids of both kernels. On the side that it keeps each
cut makes kernels larger, by the factor 1 + e^-4 at most: the ellipsoids are those of kernels that are so all over.

Where the place of a primitive depends on the direction of the ray, its box is that of all its places (``shifts.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..engine.arrays import array_types, detached
from ..engine.cuts import LOG2_LARGEST
from ..engine.rows import NO_ROW
from .primitives import Primitives

SLACK = 1e-5  # of a box, against the rounding of what is met in it


@dataclass
class Bounds:
    """Of N primitives, detached."""

    drawn: Any  # Bool [N], usable and somewhere above the cutoff
    low: list  # three columns
    high: list
    weights: list  # three columns of [M]: squared axes of the primary's ellipsoid over those of the common one


def bounds_of(primitives: Primitives, log2_range: float) -> Bounds:
    """log2_range: -log2 of the smallest kernel value that is looked at."""
    types = array_types()
    lo = detached(primitives.lo)
    more: Any = None  # by which cuts raise lo
    for plane in primitives.planes:
        raised = dr.select(detached(plane.row) != NO_ROW, types.Float(LOG2_LARGEST), 0)
        more = raised if more is None else more + raised
    if more is not None:
        lo = lo + more
    reach = [lo + log2_range] * 3  # squared radii in kernel space, by axis
    drawn = detached(primitives.usable) & (reach[0] > 0)
    weights: list = []
    if primitives.dog_row is not None:
        dog_row, dog_index = detached(primitives.dog_row), detached(primitives.dog_index)
        *inverse, pseudo_lo = (detached(c) for c in primitives.pseudo)
        pseudo_reach = pseudo_lo + log2_range
        if more is not None:
            dr.eval(more)
            pseudo_reach = pseudo_reach + dr.gather(types.Float, more, dog_index)
        dr.eval(inverse, pseudo_reach, lo)
        ratio = (dr.gather(types.Float, lo, dog_index) + log2_range) / pseudo_reach
        weights = [dr.select(pseudo_reach > 0, dr.minimum(1, ratio * f * f), 1) for f in inverse]
        weights = [dr.select(w > 0, w, 1) for w in weights]  # of what is not drawn
        dr.eval(weights)
        is_dog = dog_row != NO_ROW
        reach = [r * dr.rcp(dr.select(is_dog, dr.gather(types.Float, w, dog_row, is_dog), 1))
                 for r, w in zip(reach, weights, strict=True)]

    low, high = _boxes(primitives, reach)
    dr.eval(drawn, low, high)
    return Bounds(drawn, low, high, weights)


def _boxes(primitives: Primitives, reach: list) -> tuple[list, list]:
    """Lowest and highest corner, three columns each, around ellipsoids of these squared radii in kernel space."""
    columns = [detached(c) for c in primitives.to_kernel]
    low, high = [], []
    lengths = [columns[3 * k] ** 2 + columns[3 * k + 1] ** 2 + columns[3 * k + 2] ** 2 for k in range(3)]
    farthest = _farthest(primitives)
    for c in range(3):
        half = dr.sqrt(sum(r * dr.square(columns[3 * k + c] / n)
                           for k, (r, n) in enumerate(zip(reach, lengths, strict=True))))
        centre = detached(primitives.mean[c])
        half = half + farthest[c] if farthest else half
        half = dr.fma(half, 1 + SLACK, 1e-6 * abs(centre))
        low.append(centre - half)
        high.append(centre + half)
    return low, high


def _farthest(primitives: Primitives) -> list:
    """[N] how far from its mean place a primitive may stand along each axis of the world; empty without shifts."""
    if primitives.shift_row is None:
        return []
    G, row = [detached(c) for c in primitives.shifts], detached(primitives.shift_row)
    lengths = [dr.sqrt(dr.square(G[k]) + dr.square(G[k + 1]) + dr.square(G[k + 2])) for k in (0, 3, 6)]
    dr.eval(lengths)
    return [dr.gather(array_types().Float, length, row, row != NO_ROW) for length in lengths]
