"""Stage 3 once more: replay the walk of ``composite`` for the weights that its primitives have in a view.

Notation as in ``composite.py``; α T is the weight of a primitive at a pixel. Per primitive, over the pixels in which it
is blended:

    Σ α T, Σ T, their number, Σ e α T with a plane e, and the largest α T (0 where none is positive)
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..arrays import array_types
from ..bands import PreparedView, WalkableView
from ..frozen import frozen
from .slot_rows import SlotRows, sums_over_bands
from .walk import Meeting, Walk


def composite_weights(view: WalkableView, plane, mask=None) -> tuple[list, Any]:
    """((Σ α T, Σ T, number of pixels, Σ e α T), bits of the largest α T as UInt), [N] each.

    Floats that are not negative sort like their bits, and a maximum of integers is the same in any order.

    Args:
        plane: e [H*W].
        mask: [H*W] 1 where a pixel counts, else 0; None: all do.
    """
    largest = dr.zeros(array_types().UInt, view.n_splats)
    sums = sums_over_bands(view, 4, lambda band, *others: _composite_weights(band, plane, mask, largest, *others))
    return sums, largest


@frozen
def _composite_weights(view: PreparedView, plane, mask, largest, in_turn: bool, above: list) -> list:
    walk, rows = Walk(view), SlotRows(view.lists, 4, in_turn)
    Float, e = walk.types.Float, walk.pixels.read(plane)
    counted = None if mask is None else walk.pixels.read(mask)

    def step(meeting: Meeting, T: list, _: list) -> None:
        slot = walk.slot(meeting)
        weights, transmittance, pixels, weighted, most = (Float(0) for _ in range(5))
        for k, a in enumerate(walk.alphas(meeting).values):
            weight, behind, goes_on = walk.advance(a, T[k], meeting, k)
            blended = goes_on & (a != 0)
            blended = blended if counted is None else blended & (counted[k] > 0)
            weight = dr.select(blended, weight, 0)
            weights += weight
            weighted = dr.fma(e[k], weight, weighted)
            most = dr.maximum(most, weight)
            transmittance += dr.select(blended, T[k], 0)
            pixels += dr.select(blended, Float(1), 0)
            T[k] = behind
        rows.add(slot, [weights, transmittance, pixels, weighted], meeting.active)
        bits, some = dr.reinterpret_array(walk.types.UInt, most), meeting.active & (most > 0)
        dr.scatter_reduce(dr.ReduceOp.Max, largest, bits, meeting.splat, some, mode=dr.ReduceMode.Local)

    walk.run(step, [], "composite_weights")
    return rows.sums(above=above)
