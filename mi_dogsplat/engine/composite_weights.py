"""Stage 3 once more: replay the walk of ``composite`` for the weights that its primitives have in a view.

Notation as in ``composite.py``; α T is the weight of a primitive at a pixel. Per primitive, over the pixels in which it
is blended:

    Σ α T, Σ T, their number, Σ e α T with a plane e, and the largest α T (0 where none is positive)
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

import drjit as dr

from .composite_derivatives import add_row, sum_rows
from .frozen import frozen
from .geometry import Grid
from .tables import Tables
from .tiles import Lists
from .walk import Settings, Walk

WEIGHTS_ROW = 4  # floats per entry of the lists


@frozen
def composite_weights(
    grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings, plane, entries, largest, in_turn: bool
) -> list:
    """(Σ α T, Σ T, number of pixels, Σ e α T), [N] each.

    Args:
        plane: e [H*W].
        entries: [entries, WEIGHTS_ROW] zeros, as many as ``lists`` has entries.
        largest: [N] UInt32 zeros; afterwards the bits of the largest α T. Floats that are not negative sort like them,
            and a maximum of integers is the same in any order.
        in_turn: ``lanes_add_in_turn``.
    """
    walk = Walk(grid, lanes, tables, lists, settings)
    e = walk.read(plane)

    def body(at, T):
        T = list(T)
        for _ in range(walk.blocks.unroll):
            isect, active, at = walk.next(at)
            splat, row, dx, dy = walk.fetch(isect, active)
            entry = dr.gather(walk.UInt, lists.entry_from_isect, isect, active)
            alpha, *_ = walk.alphas(splat, row, active, dx, dy)
            weights, transmittance, pixels, weighted, most = (walk.Float(0) for _ in range(5))
            for k in range(walk.pixels):
                weight, behind, go = walk.advance(alpha[k], T[k], row, k)
                blended = go & (alpha[k] != 0)
                weight = dr.select(blended, weight, 0)
                weights += weight
                weighted = dr.fma(e[k], weight, weighted)
                most = dr.maximum(most, weight)
                transmittance += dr.select(blended, T[k], 0)
                pixels += dr.select(blended, walk.Float(1), 0)
                T[k] = behind
            add_row(walk, entries, entry, [weights, transmittance, pixels, weighted], WEIGHTS_ROW, active, in_turn)
            bits = dr.reinterpret_array(walk.UInt, most)
            dr.scatter_reduce(dr.ReduceOp.Max, largest, bits, splat, active & (most > 0), mode=dr.ReduceMode.Local)
        return at, T

    dr.while_loop(
        (walk.start(), walk.start_T()),
        lambda at, T: walk.more(at) & walk.alive(T),
        body,
        labels=("at", "T"),
        label="composite_weights",
    )
    return sum_rows(walk, entries, WEIGHTS_ROW, 4)
