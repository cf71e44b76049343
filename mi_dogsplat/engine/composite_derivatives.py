"""Derivatives of *composite*: both modes replay the walk; nothing is stored per primitive and pixel.

Notation as in ``composite.py``, and
    δx     adjoint of x in backward mode, tangent of x in forward mode

Backward mode replays the walk in the same order and needs two numbers per pixel, T and the part of δC·C that is
still to come. Each entry of the tile lists gets a row of its own for its adjoints, which only the lanes of its tile add
to; afterwards every primitive sums the rows of its entries. There is no atomic addition, and so the result has the same
bits in every run.
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from functools import lru_cache

import drjit as dr
import mitsuba as mi
import numpy as np

from .frozen import frozen
from .geometry import Blocks, Grid
from .tables import FEATURES, Tables
from .tiles import Lists
from .walk import ALPHA_MAX, Settings, Walk, planes_of

LN2 = 0.6931471805599453
ENTRY_ROW = 16  # adjoints per entry of the lists: x y ux uy vy lo, features, padding (one cache line)
PSEUDO_ENTRY_ROW = 4  # ux uy vy lo


@lru_cache
def lanes_add_in_turn(variant: str) -> bool:
    """Whether a packet ``scatter_add`` without atomics may meet the same row in all lanes of a tile.

    Dr.Jit does not promise it, but its LLVM backend (1.5) adds the lanes of a packet one after the other, which is a
    fifth faster than atomics here. So it is tried, once per variant. Where packets are narrower than a tile (CPUs
    without AVX-512), two threads may share a tile's rows: no.
    """
    Float, UInt = dr.detached_t(mi.Float), dr.detached_t(mi.UInt32)
    if dr.backend_v(mi.Float) != dr.JitBackend.LLVM:
        return False
    lanes, rows = Blocks.of_backend().lanes, 64
    lane = dr.arange(UInt, rows * lanes)
    table = dr.zeros(Float, rows * ENTRY_ROW)
    values = [Float(lane % 7) + k for k in range(ENTRY_ROW)]
    dr.scatter_add(table, dr.llvm.ArrayXf(values), lane // lanes, mode=dr.ReduceMode.NoConflicts)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.eval(table)
        wide = any(f"<{lanes} x float>" in kernel["ir"].getvalue() for kernel in dr.kernel_history([dr.KernelType.JIT]))
    value = np.arange(rows * lanes).reshape(rows, lanes) % 7
    expected = value.sum(1)[:, None] + lanes * np.arange(ENTRY_ROW)
    return wide and np.array_equal(table.numpy().reshape(rows, ENTRY_ROW), expected)


@frozen
def composite_backward(
    grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings,
    features: list, T_final, δfeatures: list, δT, entries, pseudo_entries, in_turn: bool,
) -> tuple:  # fmt: skip
    """Adjoints of the projected quantities, given those of the planes.

    Args:
        features, T_final: what ``composite`` returned.
        δfeatures, δT: their adjoints, [H*W] each.
        entries: [entries, ENTRY_ROW] zeros, as many as ``lists`` has entries.
        pseudo_entries: [entries, PSEUDO_ENTRY_ROW] zeros, or None without DoG primitives.
        in_turn: ``lanes_add_in_turn``.

    Returns (δ of x, y, ux, uy, vy, lo and of each feature, [N] each; δ of ux, uy, vy, lo of the pseudo-Gaussians,
    [M] each).
    """
    walk, n_features = Walk(grid, lanes, tables, lists, settings), settings.n_features

    δC = [walk.read(plane) for plane in δfeatures]
    # what is still to come of δC·C + δT T: all of it at the start
    rest = [δ * t for δ, t in zip(walk.read(δT), walk.read(T_final), strict=True)]
    for plane, δ in zip(features, δC, strict=True):
        rest = [dr.fma(c, d, r) for c, d, r in zip(walk.read(plane), δ, rest, strict=True)]

    def moments(δp, ux, uy, vy, dx, dy) -> list:
        """δ of x, y, ux, uy, vy, lo from δp at every pixel of the block."""
        # sums over the block of δp k^a r^b, with column k and row r counted from its corner
        m0 = mk = mr = mkk = mkr = mrr = walk.Float(0)
        for r in range(walk.blocks.height):
            row = δp[r * walk.blocks.width : (r + 1) * walk.blocks.width]
            s0, sk, skk = row[0], walk.Float(0), walk.Float(0)
            for k, δ in enumerate(row[1:], 1):
                s0, sk, skk = s0 + δ, dr.fma(k, δ, sk), dr.fma(k * k, δ, skk)
            m0, mk, mkk = m0 + s0, mk + sk, mkk + skk
            if r:
                mr, mkr, mrr = dr.fma(r, s0, mr), dr.fma(r, sk, mkr), dr.fma(r * r, s0, mrr)
        # u and v at the corner, where they are small numbers next to a needle; then sums of δp u, δp v, δp u dx, ...
        u, v = dr.fma(ux, dx, uy * dy), vy * dy
        mu, mv = dr.fma(u, m0, dr.fma(ux, mk, uy * mr)), dr.fma(v, m0, vy * mr)
        mux = dr.fma(dx, mu, dr.fma(u, mk, dr.fma(ux, mkk, uy * mkr)))
        muy = dr.fma(dy, mu, dr.fma(u, mr, dr.fma(ux, mkr, uy * mrr)))
        mvy = dr.fma(dy, mv, dr.fma(v, mr, vy * mrr))
        return [2 * ux * mu, 2 * dr.fma(uy, mu, vy * mv), -2 * mux, -2 * muy, -2 * mvy, m0]

    def body(at, T, rest):
        T, rest = list(T), list(rest)
        for _ in range(walk.blocks.unroll):
            isect, active, at = walk.next(at)
            splat, row, dx, dy = walk.fetch(isect, active)
            entry = dr.gather(walk.UInt, lists.entry_from_isect, isect, active)
            alpha, primary, pseudo, dog_row, is_dog = walk.alphas(splat, row, active, dx, dy)
            δp, δp_pseudo = [], []
            δf = [walk.Float(0)] * n_features
            for k in range(walk.pixels):
                a = alpha[k]
                weight, behind, go = walk.advance(a, T[k], row, k)
                weight = dr.select(go, weight, 0)
                c = row[FEATURES] * δC[0][k]
                for f in range(n_features):
                    δf[f] = dr.fma(weight, δC[f][k], δf[f])
                    if f:
                        c = dr.fma(row[FEATURES + f], δC[f][k], c)
                rest[k] = dr.fma(-weight, c, rest[k])
                δα = LN2 * dr.fma(T[k], c, -walk.hidden(rest[k], a, a))
                # zero where the primitive was ignored, or the walk had ended
                δα = dr.select(go & (a != 0), δα, 0)
                δp.append(dr.select(primary[k] < ALPHA_MAX, δα * primary[k], 0))
                if pseudo is not None:
                    δp_pseudo.append(dr.select(pseudo[k] < ALPHA_MAX, -δα * pseudo[k], 0))
                T[k] = behind
            δrow = moments(δp, *row[2:5], dx, dy) + δf
            if pseudo is not None:

                def pseudo_moments(entry, dog_row, dx, dy, δp_pseudo):
                    δ = moments(δp_pseudo, *walk.pseudo_row(dog_row)[:3], dx, dy)
                    add_row(walk, pseudo_entries, entry, δ[2:], PSEUDO_ENTRY_ROW, True, in_turn)
                    return δ[0], δ[1]

                δx, δy = dr.if_stmt(
                    (entry, dog_row, dx, dy, δp_pseudo),
                    is_dog,
                    pseudo_moments,
                    lambda *_: (walk.Float(0), walk.Float(0)),
                )
                δrow[0], δrow[1] = δrow[0] + δx, δrow[1] + δy
            add_row(walk, entries, entry, δrow, ENTRY_ROW, active, in_turn)
        return at, T, rest

    dr.while_loop(
        (walk.start(), walk.start_T(), rest),
        lambda at, T, rest: walk.more(at) & walk.alive(T),
        body,
        labels=("at", "T", "rest"),
        label="composite_backward",
    )
    δsplats = sum_rows(walk, entries, ENTRY_ROW, 6 + n_features)
    if tables.pseudo is None:
        return δsplats, []
    return δsplats, sum_rows(walk, pseudo_entries, PSEUDO_ENTRY_ROW, 4, tables.dog_index)


def add_row(walk: Walk, table, index, values: list, row_size: int, active, in_turn: bool) -> None:
    """Add to the first columns of row ``index`` of a table, the same row in all lanes of a tile.

    in_turn: ``lanes_add_in_turn``.

    One packet instead of a scatter per value. Never in mode ``Expand``, nor ``Auto`` which may choose it: they give
    every thread a copy of the table at an offset that a frozen kernel holds as a constant. Replayed with a larger table
    it writes out of bounds (Dr.Jit 1.5).
    """
    padded = values + [walk.Float(0)] * (row_size - len(values))
    mode = dr.ReduceMode.NoConflicts if in_turn else dr.ReduceMode.Local
    dr.scatter_add(table, walk.Packet(padded), index, active, mode=mode)


def sum_rows(walk: Walk, table, row_size: int, count: int, splat=None) -> list:
    """Sums of the first ``count`` columns over the entries of each primitive, or of the primitives ``splat``."""
    splat = dr.arange(walk.UInt, dr.width(walk.lists.entry_begin)) if splat is None else splat
    begin, end = (dr.gather(walk.UInt, ends, splat) for ends in (walk.lists.entry_begin, walk.lists.entry_end))

    def body(row, sums):
        values = []
        for k in range(-(-count // 4)):
            values += list(dr.gather(walk.Quad, table, dr.fma(row, row_size // 4, k)))
        return row + 1, [s + v for s, v in zip(sums, values, strict=False)]

    start = begin, [walk.Float(0)] * count
    return list(dr.while_loop(start, lambda row, sums: row < end, body, labels=("row", "sums"), label="sum rows")[1])


def composite_forward(
    grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings, δsplats: list, δpseudo: list | None
) -> tuple:
    """Tangents of the planes, given those of x, y, ux, uy, vy, lo and the features [N],
    and of ux, uy, vy, lo [M].

    Returns (δfeatures: list of [H*W] planes, δT: [H*W] plane).
    """
    interleaved = _composite_forward(grid, lanes, tables, lists, settings, δsplats, δpseudo)
    *δfeatures, δT = planes_of(interleaved, settings.n_features + 1)
    return δfeatures, δT


def _composite_forward(
    grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings, δsplats: list, δpseudo: list | None
) -> list:
    walk, n_features = Walk(grid, lanes, tables, lists, settings), settings.n_features

    def tangents(values, ux, uy, vy, dx, dy, δ) -> list:
        """δ of 2^p at the pixels of the block, zero where it is limited to .99."""
        result = []
        for k, value in enumerate(values):
            x, y = dx + k % walk.blocks.width, dy + k // walk.blocks.width
            u, v = dr.fma(ux, x, uy * y), vy * y
            δu = δ[2] * x + δ[3] * y - ux * δ[0] - uy * δ[1]
            δv = δ[4] * y - vy * δ[1]
            δp = δ[5] - 2 * (u * δu + v * δv)
            result.append(dr.select(value < ALPHA_MAX, LN2 * value * δp, 0))
        return result

    def body(at, T, δT, δC):
        T, δT, δC = list(T), list(δT), list(δC)
        isect, active, at = walk.next(at)
        splat, row, dx, dy = walk.fetch(isect, active)
        alpha, primary, pseudo, dog_row, is_dog = walk.alphas(splat, row, active, dx, dy)
        δ = [dr.gather(walk.Float, values, splat, active) for values in δsplats]
        δα = tangents(primary, *row[2:5], dx, dy, δ)
        if pseudo is not None:
            δ_p = δ[:2] + [dr.gather(walk.Float, values, dog_row, is_dog) for values in δpseudo or []]
            kernel = [dr.select(is_dog, value, 0) for value in walk.pseudo_row(dr.select(is_dog, dog_row, 0))[:3]]
            δα = [a - b for a, b in zip(δα, tangents(pseudo, *kernel, dx, dy, δ_p), strict=True)]
        for k in range(walk.pixels):
            weight, behind, go = walk.advance(alpha[k], T[k], row, k)
            weight = dr.select(go, weight, 0)
            δa = dr.select(go & (alpha[k] != 0), δα[k], 0)
            δweight = dr.select(go, dr.fma(δa, T[k], alpha[k] * δT[k]), 0)
            for f in range(n_features):
                p = f * walk.pixels + k
                δC[p] = dr.fma(δweight, row[FEATURES + f], dr.fma(weight, δ[6 + f], δC[p]))
            passes = go if walk.negative_transmittance else go & (alpha[k] > 0)
            δT[k] = dr.select(passes, δT[k] - δweight, δT[k])
            T[k] = behind
        return at, T, δT, δC

    _, _, δT, δC = dr.while_loop(
        (walk.start(), walk.start_T(), [walk.Float(0)] * walk.pixels, [walk.Float(0)] * (n_features * walk.pixels)),
        lambda at, T, δT, δC: walk.more(at) & walk.alive(T),
        body,
        labels=("at", "T", "δT", "δC"),
        label="composite_forward",
    )
    return walk.write([*(δC[f * walk.pixels : (f + 1) * walk.pixels] for f in range(n_features)), δT])
