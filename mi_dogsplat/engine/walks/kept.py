"""What planes leave of the kernels of a primitive at the pixels of a block (``engine/cuts.py``)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..cuts import END, LEVEL, WHOLE, by_plane


@dataclass
class Kept:
    """Of a plane, pixel by pixel."""

    values: list  # g
    falls: list  # ∂log2 g / ∂exponent, which is 1 - WHOLE g but for the rounding: next to nothing where hx may be huge


def kept_of(cut: list, offsets: Sequence[tuple], exp2: Callable[[Any], Any]) -> Kept:
    """``cut``: hx and hy of a plane, ``offsets``: (dx, dy) from the primitive's centre to each of the pixels."""
    hx, hy = (-h for h in cut)
    values, falls = [], []
    for x, y in offsets:
        inverse = exp2(dr.clip(dr.fma(hx, x, dr.fma(hy, y, -LEVEL)), -END, END))
        values.append(dr.rcp(dr.fma(inverse, WHOLE, WHOLE)))
        falls.append(inverse * (WHOLE * values[-1]))
    return Kept(values, falls)


def all_kept(cuts: list, offsets: Sequence[tuple], exp2: Callable[[Any], Any]) -> list[Kept]:
    """Of each plane, ``cuts`` being their hx and hy."""
    return [kept_of(cut, offsets, exp2) for cut in by_plane(cuts)]


def left_of(values: list, planes: Sequence[Kept]) -> list:
    """What these planes leave of the ``values`` of a kernel."""
    for kept in planes:
        values = [v * g for v, g in zip(values, kept.values, strict=True)]
    return values
