"""What planes leave of the kernels of a primitive at the pixels of a block (``engine/cuts.py``).

g = (1 + 2^-L) / (1 + 2^e) with an exponent e = -(L + hx dx + hy dy) that is linear in the offset of the pixel. From
pixel to pixel of a patch 2^e is multiplied by a constant of the primitive, as kernels are in ``kernel_values.py``:

    2^e(dx+1, dy) = 2^e 2^-hx,   2^e(dx, dy+1) = 2^e 2^-hy.

With (hx, hy) of length ``LONGEST`` at most, 2^e changes by less than 2^98 over 4 x 4 pixels. So where e is cut to
±``END`` at the first of them, g is within 2^-27 of its limits at all of them, as it should be. 2^e may become infinite,
or 0: g is then 0 or as large as it can be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..cuts import END, LEVEL, WHOLE, by_plane
from ..geometry import Blocks


@dataclass
class Kept:
    """Of a plane, pixel by pixel."""

    values: list  # g
    falls: list  # ∂log2 g / ∂(L + hx dx + hy dy)


def kept_of(cut: list, dx: Any, dy: Any, blocks: Blocks, patch: int, exp2: Callable[[Any], Any]) -> Kept:
    """At the pixels of the block, row by row.

    Args:
        cut: hx and hy of a plane.
        dx, dy: from the centre of the primitive to the first pixel of the block.
        patch: width and height of a patch, pixels.
    """
    hx, hy = (-h for h in cut)
    right, down = exp2(hx), exp2(hy)
    values: list = [None] * (blocks.width * blocks.height)
    for columns, rows in blocks.patches(patch):
        exponent = dr.fma(hx, dx + columns[0], dr.fma(hy, dy + rows[0], -LEVEL))
        first = exp2(dr.clip(exponent, -END, END))
        for row in rows:
            power = first
            for column in columns:
                values[row * blocks.width + column] = dr.rcp(dr.fma(power, WHOLE, WHOLE))
                power = power * right
            first = first * down
    return Kept(values, [dr.fma(-WHOLE, g, 1) for g in values])


def all_kept(cuts: list, *block: Any) -> list[Kept]:
    """Of each plane, ``cuts`` being their hx and hy; what else ``kept_of`` takes."""
    return [kept_of(cut, *block) for cut in by_plane(cuts)]


def left_of(values: list, planes: Sequence[Kept]) -> list:
    """What these planes leave of the ``values`` of a kernel."""
    for kept in planes:
        values = [v * g for v, g in zip(values, kept.values, strict=True)]
    return values
