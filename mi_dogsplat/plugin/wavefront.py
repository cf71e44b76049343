"""The rays of several views of one size in one wavefront, where they lie one view after the other.

Python needs as long for a segment of light paths however few they are: milliseconds, in which a processor traces
thousands of rays, and a GPU millions. So passes of small pictures are traced together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.arrays import array_types

RAYS = 2**18, 2**21  # on a processor, and on a GPU: the most that are traced together, unless a view has more
PRIMITIVES = 2**19  # of which views are held meanwhile, 400 bytes each with derivatives


def views_at_once(rays: int, primitives: int) -> int:
    """How many views are traced together, each of so many rays and primitives."""
    most = RAYS[0] if array_types().is_llvm else RAYS[1]
    return max(1, min(most // max(rays, 1), PRIMITIVES // max(primitives, 1)))


def joined(views: Sequence[Sequence[Any]]) -> list:
    """Planes of each view to planes of the wavefront, evaluated; constants."""
    if len(views) == 1:
        return list(views[0])
    n = max(dr.width(plane) for view in views for plane in view)  # a constant plane may have one value
    planes = [dr.empty(type(plane), len(views) * n) for plane in views[0]]
    for k, view in enumerate(views):
        lane = _lanes(k, n)
        for plane, part in zip(planes, view, strict=True):
            dr.scatter(plane, dr.detach(part), lane, mode=dr.ReduceMode.Permute)
        dr.eval(planes)  # view by view: all at once would be a kernel for each number of views
    return planes


def parted(planes: Sequence[Any], count: int) -> list[list]:
    """Planes of a wavefront to those of each of its ``count`` views; constants."""
    if count == 1:
        return [list(planes)]
    n = max(dr.width(plane) for plane in planes) // count
    return [[dr.gather(type(plane), plane, _lanes(k, n)) for plane in planes] for k in range(count)]


def add_to(sums: Any, value: Any, ray: Any, active: Any = True) -> None:
    """Add what lanes bring to that of their rays; none has two. So atomics are not asked for: on a processor they are
    other kernels in small wavefronts than in large ones, and depend on the number of threads."""
    dr.scatter_add(sums, value, ray, active, mode=dr.ReduceMode.NoConflicts)


def _lanes(view: int, n: int) -> mi.UInt32:
    return dr.arange(mi.UInt32, n) + dr.opaque(mi.UInt32, view * n)
