"""2^p of a kernel at all pixels of a lane's block, with three exponentials for each patch of up to 4 x 4 pixels.

p = lo - u² - v² with u = ux dx + uy dy and v = vy dy, as in ``screen_kernels.py``. From pixel to pixel of a patch
2^p is multiplied by a ratio, and the ratio by a constant of the primitive,

    2^p(dx+1, dy) = 2^p r,   r = 2^(-ux (2u + ux)),                     r(dx+1, dy) = r q,   r(dx, dy+1) = r s,
    2^p(dx, dy+1) = 2^p d,   d = 2^(-uy (2u + uy) - vy (2v + vy)),      d(dx, dy+1) = d t,
    q = 2^(-2 ux²),  s = 2^(-2 ux uy),  t = 2^(-2 (uy² + vy²)).

Thanks to the 0.3 px² low-pass filter a kernel that is visible anywhere in a patch is above 2^-90 at its first pixel:
float32 does not underflow, and six steps lose a few ulp.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr

from ..geometry import Blocks
from ..tables import KernelRow

DEAD_PATCH = -120.0  # a patch that starts below 2^-120 is dead: flushed to 0, so that no ratio can revive it


def kernel_values(kernel: KernelRow, dx, dy, blocks: Blocks, patch: int, exp2: Callable[[Any], Any]) -> list:
    """2^p at the pixels of the block, row by row.

    Args:
        dx, dy: from the centre of the kernel to the first pixel of the block.
        patch: width and height of a patch, pixels.
    """
    values: list = [None] * (blocks.width * blocks.height)
    for columns, rows in blocks.patches(patch):
        first, right, down = _first_pixel(kernel, dx + columns[0], dy + rows[0], exp2)
        for row in rows:
            value, ratio = first, right
            for column in columns:
                values[row * blocks.width + column] = value
                value, ratio = value * ratio, ratio * kernel.q
            first, right, down = first * down, right * kernel.s, down * kernel.t
    return values


def _first_pixel(kernel: KernelRow, dx, dy, exp2: Callable[[Any], Any]) -> tuple:
    """(2^p, r, d) at the first pixel of a patch."""
    ux, uy, vy = kernel.ux, kernel.uy, kernel.vy
    u, v = dr.fma(ux, dx, uy * dy), vy * dy
    p = dr.fma(-u, u, dr.fma(-v, v, kernel.lo))
    live = p > DEAD_PATCH  # then the ratios are between 2^-37 and 2^37
    first = dr.select(live, exp2(p), 0)
    right = exp2(dr.select(live, -ux * dr.fma(2, u, ux), 0))
    down = exp2(dr.select(live, dr.fma(-uy, dr.fma(2, u, uy), -vy * dr.fma(2, v, vy)), 0))
    return first, right, down
