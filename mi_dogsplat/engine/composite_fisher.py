"""Stage 3 once more: replay the walk of ``composite`` for how the image, patch by patch, depends on each primitive.

Notation as in ``composite_score.py``: d, the derivative of a channel by α. Of a primitive, in a patch of 4 x 4 pixels,

    g_c = Σ d_c ∂α/∂(x, y, ux, uy, vy)     derivative of the patch's sum of channel c by the projected shape, 5 numbers
    s   = Σ α T                             derivative of the same by the primitive's colour in that channel

and the result adds up, over patches, their products: what the squares of derivatives of the image by any parameters
behind the projection are made of (``compare/rivals/pup.py``). Of a DoG primitive: by the shape of the primary kernel.
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from dataclasses import replace

import drjit as dr

from .composite_derivatives import LN2, add_row, sum_rows
from .frozen import frozen
from .geometry import Blocks, Grid
from .tables import FEATURES, Tables
from .tiles import Lists
from .walk import ALPHA_MAX, Settings, Walk

SHAPE = 5  # numbers of a projected shape: x y ux uy vy
PAIRS = [(i, j) for i in range(SHAPE) for j in range(i, SHAPE)]
COLUMNS = len(PAIRS) + 3 * SHAPE + 1
FISHER_ROW = 32  # floats per entry of the lists: the columns, padding


def patch_blocks() -> Blocks:
    """The backend's blocks, made to be patches of 4 x 4 pixels."""
    return replace(Blocks.of_backend(), width=4, height=4)


@frozen
def composite_fisher(
    grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings, image: list, entries, in_turn: bool
) -> list:
    """Sums over the patches of a view: Σ_c g_c[i] g_c[j] for ``PAIRS``, then s g_c[i] by channel, then s²; [N] each.

    Args:
        grid: made of ``patch_blocks``; the lists must be those of this grid.
        image: the 3 planes of the view [H*W], background included.
        entries: [entries, FISHER_ROW] zeros, as many as ``lists`` has entries.
        in_turn: ``lanes_add_in_turn``.
    """
    walk = Walk(grid, lanes, tables, lists, settings)
    behind = [walk.read(plane) for plane in image]

    def body(at, T, behind):
        T, behind = list(T), [list(plane) for plane in behind]
        isect, active, at = walk.next(at)
        splat, row, dx, dy = walk.fetch(isect, active)
        entry = dr.gather(walk.UInt, lists.entry_from_isect, isect, active)
        alpha, primary, *_ = walk.alphas(splat, row, active, dx, dy)
        ux, uy, vy = row[2:5]
        g = [[walk.Float(0)] * SHAPE for _ in range(3)]
        s = walk.Float(0)
        for k in range(walk.pixels):
            a = alpha[k]
            weight, T_behind, go = walk.advance(a, T[k], row, k)
            blended = go & (a != 0)
            weight = dr.select(blended, weight, 0)
            s = s + weight
            x, y = dx + k % walk.blocks.width, dy + k // walk.blocks.width
            u, v = dr.fma(ux, x, uy * y), vy * y
            slope = dr.select(blended & (primary[k] < ALPHA_MAX), LN2 * primary[k], 0)  # ∂α/∂p
            by_shape = [2 * u * ux, 2 * dr.fma(u, uy, v * vy), -2 * u * x, -2 * u * y, -2 * v * y]  # ∂p
            for c in range(3):
                behind[c][k] = dr.fma(-weight, row[FEATURES + c], behind[c][k])
                d = slope * dr.fma(T[k], row[FEATURES + c], -walk.hidden(behind[c][k], a, a))
                g[c] = [dr.fma(d, by, value) for by, value in zip(by_shape, g[c], strict=True)]
            T[k] = T_behind
        products = [g[0][i] * g[0][j] + g[1][i] * g[1][j] + g[2][i] * g[2][j] for i, j in PAIRS]
        products += [s * value for channel in g for value in channel]
        add_row(walk, entries, entry, [*products, s * s], FISHER_ROW, active, in_turn)
        return at, T, behind

    dr.while_loop(
        (walk.start(), walk.start_T(), behind),
        lambda at, T, behind: walk.more(at) & walk.alive(T),
        body,
        labels=("at", "T", "behind"),
        label="composite_fisher",
    )
    return sum_rows(walk, entries, FISHER_ROW, COLUMNS)
