"""What a cut leaves of the kernels of a primitive at the pixels of a block (``engine/cuts.py``)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..cuts import END, LEVEL, WHOLE


@dataclass
class Kept:
    """Pixel by pixel."""

    values: list  # g
    falls: list  # ∂log2 g / ∂exponent, which is 1 - WHOLE g but for the rounding: next to nothing where hx may be huge


def kept_of(cut: list, offsets: Iterable[tuple], exp2: Callable[[Any], Any]) -> Kept:
    """``cut``: hx and hy of the primitive, ``offsets``: (dx, dy) from its centre to each of the pixels."""
    hx, hy = (-h for h in cut)
    values, falls = [], []
    for x, y in offsets:
        inverse = exp2(dr.clip(dr.fma(hx, x, dr.fma(hy, y, -LEVEL)), -END, END))
        values.append(dr.rcp(dr.fma(inverse, WHOLE, WHOLE)))
        falls.append(inverse * (WHOLE * values[-1]))
    return Kept(values, falls)
