"""How a lane walks down its list of primitives: what all kernels that blend, or replay the blending, have in common.

Notation as in ``composite.py``. A lane owns a block of pixels, unrolled here in Python; the lanes of a packet are one
tile, each with the entries of the tile's list that touch its block (``tiles.py``). The pixels of a patch of 4 x 4 share
three exponentials: from pixel to pixel 2^p is multiplied by a ratio, and the ratio by a constant of the primitive,

    2^p(dx+1, dy) = 2^p r,   r = 2^(-ux (2u + ux)),                     r(dx+1, dy) = r q,   r(dx, dy+1) = r s,
    2^p(dx, dy+1) = 2^p d,   d = 2^(-uy (2u + uy) - vy (2v + vy)),      d(dx, dy+1) = d t,
    q = 2^(-2 ux²),  s = 2^(-2 ux uy),  t = 2^(-2 (uy² + vy²)).

Thanks to the 0.3 px² low-pass filter a kernel that is visible anywhere in a patch is above 2^-90 at its first pixel:
float32 does not underflow, and six steps lose a few ulp.
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from operator import and_
from typing import Any

import drjit as dr
import mitsuba as mi

from .geometry import Cutoffs, Grid
from .project import NOT_DOG
from .tables import FEATURES, PSEUDO_ROW, Tables, row_size
from .tiles import WORD, Lists

ALPHA_MAX = 0.99
DEAD_PATCH = -120.0  # a patch that starts below 2^-120 is dead: flushed to 0, so that no ratio can revive it
EXP2 = (1.00000007, 0.693146967, 0.240221197, 0.0555071327, 0.00967554, 0.00132765)  # 2^x, |x| <= 1/2, to 8e-8
MAX_T = 2.0**30  # only a stack of negative lobes gets there; float32 would end in ∞ and NaN


def exp2(x):
    """2^x to 2e-7 for -126 < x < 127; anything elsewhere. Half the instructions of ``dr.exp2``, which also saturates.

    Adding 1.5 2^23 rounds x to an integer, whose low bits are then those of the sum: shifted, they are the exponent.
    """
    Int: Any = dr.int32_array_t(type(x))
    whole = x + 12582912.0
    rest = x - (whole - 12582912.0)
    value = type(x)(EXP2[-1])
    for c in EXP2[-2::-1]:
        value = dr.fma(value, rest, c)
    bits, exponent = Int(dr.reinterpret_array(Int, value)), Int(dr.reinterpret_array(Int, whole)) << 23
    return dr.reinterpret_array(type(x), bits + exponent)


@dataclass(frozen=True)
class Settings:
    """What the kernels are specialised to.

    negative_transmittance: a negative α amplifies what lies behind, T (1 - α) > T; else it leaves T as it is.
    patch: width and height of the pixels that share their exponentials, 1 to 4; 1 gives each pixel its own.
    """

    n_features: int
    cutoffs: Cutoffs = Cutoffs()
    negative_transmittance: bool = True
    patch: int = 4


class Walk:
    """Trace-time helper: one lane's block of pixels walking its tile's list. Holds what the three modes share."""

    def __init__(self, grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings):
        self.Float, self.UInt = dr.detached_t(mi.Float), dr.detached_t(mi.UInt32)
        backend = dr.llvm if dr.backend_v(mi.Float) == dr.JitBackend.LLVM else dr.cuda
        self.Quad, self.Packet = backend.Array4f, backend.ArrayXf
        self.is_llvm = backend is dr.llvm
        self.exp2: Callable[[Any], Any] = exp2 if self.is_llvm else dr.exp2
        self.grid, self.tables, self.lists = grid, tables, lists
        self.cutoffs, self.columns = settings.cutoffs, FEATURES + settings.n_features
        self.row_size = row_size(settings.n_features)
        self.patch = settings.patch
        self.negative_transmittance = settings.negative_transmittance or tables.pseudo is None
        self.rises = tables.pseudo is not None and settings.negative_transmittance  # T may
        self.blocks = grid.blocks
        self.pixels = self.blocks.width * self.blocks.height
        tile, x, y = lanes
        begin, end = (dr.gather(self.UInt, ends, tile) for ends in (lists.begin, lists.end))
        self.begin, self.tile = begin, tile
        self.last = dr.select(begin < end, (end - 1) // WORD + 1, 0)
        self.lane = dr.arange(self.UInt, dr.width(tile)) % grid.blocks.lanes
        self.x0, self.y0 = self.Float(x) + 0.5, self.Float(y) + 0.5
        if self.is_llvm:
            self._align_stack()
        columns = [(x + k) < grid.width for k in range(self.blocks.width)]
        row_ok = [(y + k) < grid.height for k in range(self.blocks.height)]
        self.inside = [r & c for r in row_ok for c in columns]
        base = y * grid.width + x
        self.at = [base + (r * grid.width + c) for r in range(self.blocks.height) for c in range(self.blocks.width)]
        self.stop_depth = None if tables.stop_depth is None else self.read(tables.stop_depth)

    def _align_stack(self) -> None:
        """Local memory that LLVM cannot optimise away, always 0, makes it align the stack to cache lines.

        Otherwise (LLVM 19) each of the vectors that do not fit the registers lies across two of them.
        """
        scratch = dr.alloc_local(self.Float, 2, value=self.Float(0))
        scratch[self.begin & 1] = self.Float(self.begin >> 31)
        self.x0 = self.x0 + scratch[self.last & 1]

    # --- pixels in and out ---

    def start_T(self) -> list:
        """1 inside the image; pixels beyond its border are born dead (negative), so that they end no walk late."""
        return [dr.select(ok, self.Float(1), self.Float(-1)) for ok in self.inside]

    def read(self, plane) -> list:
        return [dr.gather(self.Float, plane, at, ok) for at, ok in zip(self.at, self.inside, strict=True)]

    def write(self, planes: list[list]) -> list[mi.Float]:
        """Planes, interleaved in fours: [H*W, 4] arrays, which ``planes_of`` takes apart.

        Packets of four cost a fourth of what single values do. Written pixel by pixel: Dr.Jit computes values in the
        order in which they are written, and so needs fewer at once.
        """
        n_pixels, zero = self.grid.width * self.grid.height, [self.Float(0)] * self.pixels
        quads = [planes[k : k + 4] for k in range(0, len(planes), 4)]
        quads[-1] += [zero] * (4 - len(quads[-1]))
        targets = [dr.empty(self.Float, 4 * n_pixels) for _ in quads]
        for k, (at, ok) in enumerate(zip(self.at, self.inside, strict=True)):
            for target, quad in zip(targets, quads, strict=True):
                dr.scatter(target, self.Quad([values[k] for values in quad]), at, ok, mode=dr.ReduceMode.Permute)
        return targets

    # --- one primitive ---

    def alive(self, T: list):
        """Some pixel still transmits: finished pixels carry -T, and so the sign is set in the bits that all share."""
        Int: Any = dr.int32_array_t(self.Float)
        bits: Any = reduce(and_, (dr.reinterpret_array(Int, t) for t in T))
        return bits >= 0

    def packets(self, table, row, row_size: int, columns: int, active=True) -> list:
        """The first ``columns`` floats of a row, in packets of eight and four."""
        values = []
        while len(values) < columns:
            size = 8 if columns - len(values) > 4 else 4
            index = dr.fma(row, row_size // size, len(values) // size)
            if size == 8:
                values += list(dr.gather(self.Packet, table, index, active, shape=(8, dr.width(index))))
            else:
                values += list(dr.gather(self.Quad, table, index, active))
        return values

    def start(self) -> tuple:
        """Where a lane is in its list: (entries of the present word that are still to come, the next word's number)."""
        return self.UInt(0), self.begin // WORD

    def more(self, at):
        """Whether the list goes on."""
        bits, group = at
        return (bits != 0) | (group < self.last)

    def next(self, at) -> tuple:
        """(next entry, whether there is one, where the lane then is). An empty word costs a step without an entry."""
        bits, group = at
        refill = (bits == 0) & (group < self.last)
        word = dr.gather(self.UInt, self.lists.words, (self.tile + group) * self.blocks.lanes + self.lane, refill)
        bits, group = dr.select(refill, word, bits), dr.select(refill, group + 1, group)
        return dr.fma(group - 1, WORD, dr.tzcnt(bits)), bits != 0, (bits & (bits - 1), group)

    def fetch(self, entry, active) -> tuple:
        """(primitive, its row of the table, dx, dy) of an entry; inactive lanes get an empty kernel."""
        splat = dr.gather(self.UInt, self.lists.splat_from_isect, entry, active)
        row = self.packets(self.tables.splats, splat, self.row_size, self.columns, active)
        row[5] = dr.select(active, row[5], 2 * DEAD_PATCH)
        return splat, row, self.x0 - row[0], self.y0 - row[1]

    def kernel(self, ux, uy, vy, lo, q, s, t, dx, dy) -> list:
        """2^p at the pixels of the block, row by row."""
        width, height, patch = self.blocks.width, self.blocks.height, self.patch
        values = [None] * self.pixels
        for top in range(0, height, patch):
            for left in range(0, width, patch):
                y = dy + top
                u, v = dr.fma(ux, dx + left, uy * y), vy * y
                p = dr.fma(-u, u, dr.fma(-v, v, lo))
                live = p > DEAD_PATCH  # then the ratios are between 2^-37 and 2^37
                first = dr.select(live, self.exp2(p), 0)
                right = self.exp2(dr.select(live, -ux * dr.fma(2, u, ux), 0))
                down = self.exp2(dr.select(live, dr.fma(-uy, dr.fma(2, u, uy), -vy * dr.fma(2, v, vy)), 0))
                for row in range(top, min(top + patch, height)):
                    value, ratio = first, right
                    for column in range(left, min(left + patch, width)):
                        values[row * width + column] = value
                        value, ratio = value * ratio, ratio * q
                    first, right, down = first * down, right * s, down * t
        return values

    def pseudo_kernel(self, splat, active, dx, dy) -> tuple:
        """2^p' of the pseudo-Gaussian, zeros for a plain primitive: packets without a DoG primitive jump over it."""
        row = dr.gather(self.UInt, self.tables.dog_row, splat, active)
        is_dog = active & (row != NOT_DOG)

        def evaluate(row, dx, dy):
            return self.kernel(*self.pseudo_row(row), dx, dy)

        def zeros(row, dx, dy):
            return [self.Float(0)] * self.pixels

        values = dr.if_stmt((row, dx, dy), is_dog, evaluate, zeros)
        return list(values), row, is_dog

    def pseudo_row(self, row) -> list:
        return self.packets(self.tables.pseudo, row, PSEUDO_ROW, PSEUDO_ROW)[:7]

    def alphas(self, splat, row, active, dx, dy) -> tuple:
        """(α per pixel, primary values, pseudo values or None, its row, is_dog)."""
        primary = self.kernel(*row[2:FEATURES], dx, dy)
        if self.tables.pseudo is None:
            alpha = [dr.select(v >= self.cutoffs.alpha, dr.minimum(v, ALPHA_MAX), 0) for v in primary]
            return alpha, primary, None, None, None
        pseudo, dog_row, is_dog = self.pseudo_kernel(splat, active, dx, dy)
        alpha = []
        for v, v_p in zip(primary, pseudo, strict=True):
            a = dr.minimum(v, ALPHA_MAX) - dr.minimum(v_p, ALPHA_MAX)
            alpha.append(dr.select(dr.abs(a) >= self.cutoffs.alpha, a, 0))
        return alpha, primary, pseudo, dog_row, is_dog

    def advance(self, alpha, T, row: Any = (), k: int = 0) -> tuple:
        """(weight α T of the primitive, T behind it, or -T where the walk has ended, whether it is blended)."""
        weight = alpha * T
        behind = T - (weight if self.negative_transmittance else dr.maximum(weight, 0))
        go = behind >= self.cutoffs.transmittance
        if self.rises:
            go &= behind <= MAX_T
        if self.stop_depth is not None:
            go &= row[FEATURES + 3] <= self.stop_depth[k]
        return weight, dr.select(go, behind, -dr.abs(T)), go

    def hidden(self, behind, alpha, blended_alpha):
        """By how much a primitive dims the light ``behind`` it, per unit of α: the image's derivative is T c - this."""
        light = behind / (1 - blended_alpha)  # as it would be without the primitive
        return light if self.negative_transmittance else dr.select(alpha > 0, light, 0)


def planes_of(interleaved: list, count: int) -> list:
    """The first ``count`` planes, [H*W] each, of what ``Walk.write`` wrote; gathered by the kernels that use them."""
    Quad = dr.llvm.Array4f if dr.backend_v(interleaved[0]) == dr.JitBackend.LLVM else dr.cuda.Array4f
    index = dr.arange(dr.uint32_array_t(type(interleaved[0])), dr.width(interleaved[0]) // 4)
    return [plane for quads in interleaved for plane in dr.gather(Quad, quads, index)][:count]
