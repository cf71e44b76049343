"""What a lane adds up over the pixels of its block: adjoints of a primitive's numbers, from those at the pixels.

(dx, dy) lead from the centre of the primitive to the first pixel. Pixels are counted from there, by column k and row r.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

from ..arrays import array_types
from ..curvatures import curved_slope
from ..geometry import Blocks
from ..tables import CentredKernel, KernelRow


def block_sums(values: list, blocks: Blocks) -> tuple:
    """Of ``values``, one per pixel, row by row, times 1, k, r, k², k r and r². What nobody uses is never evaluated."""
    Float = array_types().Float
    m0 = mk = mr = mkk = mkr = mrr = Float(0)
    for r in range(blocks.height):
        row = values[r * blocks.width : (r + 1) * blocks.width]
        s0, sk, skk = row[0], Float(0), Float(0)
        for k, value in enumerate(row[1:], 1):
            s0, sk, skk = s0 + value, dr.fma(k, value, sk), dr.fma(k * k, value, skk)
        m0, mk, mkk = m0 + s0, mk + sk, mkk + skk
        if r:
            mr, mkr, mrr = dr.fma(r, s0, mr), dr.fma(r, sk, mkr), dr.fma(r * r, s0, mrr)
    return m0, mk, mr, mkk, mkr, mrr


def dot(a: Sequence, b: Sequence) -> Any:
    """Σ a b, in the order of the pixels."""
    total = array_types().Float(0)
    for x, y in zip(a, b, strict=True):
        total = dr.fma(x, y, total)
    return total


def kernel_adjoints(δp: list, kernel: KernelRow, dx: Any, dy: Any, blocks: Blocks) -> CentredKernel:
    """δ of a kernel from δp at every pixel, of p = lo - u² - v².

    ∂p/∂(ux, uy, vy) = -2 (u dx, u dy, v dy), ∂p/∂(x, y) = 2 (u ux, u uy + v vy). At the pixel (k, r) u is larger by
    k ux + r uy than at the first one, v by r vy: so all sums are made of six moments of δp.
    """
    ux, uy, vy = kernel.ux, kernel.uy, kernel.vy
    m0, mk, mr, mkk, mkr, mrr = block_sums(δp, blocks)
    # u and v at the first pixel, where they are small numbers next to a needle; then sums of δp u, δp v, δp u dx, ...
    u, v = dr.fma(ux, dx, uy * dy), vy * dy
    mu, mv = dr.fma(u, m0, dr.fma(ux, mk, uy * mr)), dr.fma(v, m0, vy * mr)
    mux = dr.fma(dx, mu, dr.fma(u, mk, dr.fma(ux, mkk, uy * mkr)))
    muy = dr.fma(dy, mu, dr.fma(u, mr, dr.fma(ux, mkr, uy * mrr)))
    mvy = dr.fma(dy, mv, dr.fma(v, mr, vy * mrr))
    return CentredKernel(2 * ux * mu, 2 * dr.fma(uy, mu, vy * mv), -2 * mux, -2 * muy, -2 * mvy, m0)


def plane_adjoints(δexponents: list, hx: Any, hy: Any, dx: Any, dy: Any, blocks: Blocks) -> list:
    """δ of x, y, hx and hy from δ of hx dx + hy dy at every pixel."""
    m0, mk, mr, *_ = block_sums(δexponents, blocks)
    return [-hx * m0, -hy * m0, dr.fma(dx, m0, mk), dr.fma(dy, m0, mr)]


def curvature_adjoints(δbrightness: list, q: list, dx: Any, dy: Any, blocks: Blocks) -> list:
    """δ of x, y, qxx, qxy and qyy from δ of qxx dx² + qxy dx dy + qyy dy² at every pixel."""
    m0, mk, mr, mkk, mkr, mrr = block_sums(δbrightness, blocks)
    mx, my = dr.fma(dx, m0, mk), dr.fma(dy, m0, mr)  # sums of δ dx, δ dy; then of δ dx², δ dx dy, δ dy²
    mxx, mxy, myy = dr.fma(dx, mx + mk, mkk), dr.fma(dy, mx, dr.fma(dx, mr, mkr)), dr.fma(dy, my + mr, mrr)
    by_x, by_y = curved_slope(q, mx, my)
    return [-by_x, -by_y, mxx, mxy, myy]
