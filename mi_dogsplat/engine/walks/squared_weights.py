"""Stage 3 once more: replay the walk of ``composite`` for how the picture depends on the colours of its primitives.

Notation as in ``composite.py``; w = α T is the weight of a primitive at a pixel. A change δc of its colour changes the
picture by w δc, and no other weight. So the squared change of the picture is δc² Σ w², for changes of any size. The
walk finds Σ w² of each primitive, over the pixels in which it is blended.
"""

from __future__ import annotations

import drjit as dr

from ..bands import PreparedView, WalkableView
from ..frozen import frozen
from .slot_rows import SlotRows, sums_over_bands
from .walk import Meeting, Walk


def composite_squared_weights(view: WalkableView, mask=None):
    """Σ w², [N]; with a ``mask`` [H*W] over the pixels where it is 1, else 0, or else Σ mask w²."""
    (sums,) = sums_over_bands(view, 1, lambda band, *others: _squared_weights(band, mask, *others))
    return sums


@frozen
def _squared_weights(view: PreparedView, mask, in_turn: bool, above: list) -> list:
    walk, rows = Walk(view), SlotRows(view.lists, 1, in_turn)
    counted = None if mask is None else walk.pixels.read(mask)

    def step(meeting: Meeting, T: list, _: list) -> None:
        slot = walk.slot(meeting)
        squared = walk.types.Float(0)
        for k, a in enumerate(walk.alphas(meeting).values):
            weight, T[k], goes_on = walk.advance(a, T[k], meeting, k)
            weight = dr.select(goes_on, weight, 0)
            squared = dr.fma(weight if counted is None else weight * counted[k], weight, squared)
        rows.add(slot, [squared], meeting.active)

    walk.run(step, [], "composite_squared_weights")
    return rows.sums(above=above)
