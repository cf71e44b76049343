"""Stage 3 once more: replay the walk of ``composite`` for how the picture depends on the colours of its primitives.

Notation as in ``composite.py``; w = α T is the weight of a primitive at a pixel. A change δc of its colour changes the
picture by w δc, and no other weight: per channel, with e the derivative of half a squared error by the picture,

    |e + w δc|² = |e|² + 2 δc Σ e w + δc² Σ w²

is exact for changes of any size. Per primitive, over the pixels in which it is blended: Σ w², then Σ e w of each plane
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..bands import PreparedView, WalkableView
from ..frozen import frozen
from .slot_rows import SlotRows, columns_of, lanes_add_in_turn
from .walk import Meeting, Walk


def composite_color_products(view: WalkableView, planes: list) -> list:
    """Σ w² and Σ e w for each plane e [H*W]; [N] each."""
    in_turn, count = lanes_add_in_turn(mi.variant()), 1 + len(planes)

    def walk(band: PreparedView, above: list) -> list:
        return columns_of(_color_products(band, planes, in_turn, above), band.lists, count)

    return view.walked(walk, [])


@frozen
def _color_products(view: PreparedView, planes: list, in_turn: bool, above: list) -> list:
    walk, rows = Walk(view), SlotRows(view.lists, 1 + len(planes), in_turn)
    Float, errors = walk.types.Float, [walk.pixels.read(plane) for plane in planes]

    def step(meeting: Meeting, T: list, _: list) -> None:
        slot = walk.slot(meeting)
        squared, products = Float(0), [Float(0) for _ in errors]
        for k, a in enumerate(walk.alphas(meeting).values):
            weight, T[k], goes_on = walk.advance(a, T[k], meeting, k)
            weight = dr.select(goes_on, weight, 0)
            squared = dr.fma(weight, weight, squared)
            products = [dr.fma(e[k], weight, total) for e, total in zip(errors, products, strict=True)]
        rows.add(slot, [squared, *products], meeting.active)

    walk.run(step, [], "composite_color_products")
    return rows.sums(above=above)
