"""Stage 3, *composite*: blend every pixel's primitives front to back.

Notation (Kerbl et al. 2023, Sec. 6; DoG as in the method paper, Sec. 3.3)
    p      log2 of a kernel's value at a pixel, lo - u² - v²,  u = ux dx + uy dy,  v = vy dy
    α      min(.99, 2^p), for a DoG primitive min(.99, 2^p) - min(.99, 2^p'), ignored where |α| < 1/255
    T      transmittance in front of the primitive; T ← T (1 - α), the walk ends before T would fall below 1e-4, or,
           behind very many negative α, exceed 2^30
    C      Σ c α T, for each feature c (the colour channels, and depth if asked for)

How it runs: a lane owns a block of pixels, unrolled here in Python; the lanes of a packet are one tile and so walk
the same list of primitives in step (``geometry.py``). The pixels of a patch of 4 x 4 share three exponentials: from
pixel to pixel 2^p is multiplied by a ratio, and the ratio by a constant of the primitive,

    2^p(dx+1, dy) = 2^p r,   r = 2^(-ux (2u + ux)),                     r(dx+1, dy) = r q,   r(dx, dy+1) = r s,
    2^p(dx, dy+1) = 2^p d,   d = 2^(-uy (2u + uy) - vy (2v + vy)),      d(dx, dy+1) = d t,
    q = 2^(-2 ux²),  s = 2^(-2 ux uy),  t = 2^(-2 (uy² + vy²)).

Thanks to the 0.3 px² low-pass filter a kernel that is visible anywhere in a patch is above 2^-90 at its first pixel:
float32 does not underflow, and six steps lose a few ulp.
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from .geometry import Cutoffs, Grid
from .project import NOT_DOG, Kernels, Projection
from .tiles import Lists

ALPHA_MAX = 0.99
DEAD_PATCH = -120.0  # a patch that starts below 2^-120 is dead: flushed to 0, so that no ratio can revive it
MAX_RATIO = 60.0  # log2; only dead patches exceed it
MAX_T = 2.0**30  # only a stack of negative lobes gets there; float32 would end in ∞ and NaN
FEATURES = 9  # first feature in a primitive's row: x y ux uy vy lo q s t, then the features
PSEUDO_ROW = 8  # floats per pseudo-Gaussian: ux uy vy lo q s t, padding


@dataclass
class Tables:
    """Projected primitives, row-major, one or two cache lines each; what the compositor reads."""

    splats: mi.Float  # [N, row_size]
    pseudo: mi.Float | None  # [M, PSEUDO_ROW]
    dog_row: mi.UInt32 | None  # [N]
    dog_index: mi.UInt32 | None  # [M]
    stop_depth: mi.Float | None = None  # [H*W], deeper primitives (by the feature after the colours) are not blended


def row_size(n_features: int) -> int:
    """Floats per primitive in the table, a multiple of four for packet loads."""
    return -(-(FEATURES + n_features) // 4) * 4


def _pack(columns: list, stride: int) -> mi.Float:
    n = max(dr.width(c) for c in columns)
    Float = dr.detached_t(mi.Float)
    table = dr.empty(Float, n * stride)
    index = dr.arange(dr.detached_t(mi.UInt32), n)
    for k, column in enumerate(columns):
        value = dr.detach(column, preserve_type=False)
        dr.scatter(table, value, dr.fma(index, stride, k), mode=dr.ReduceMode.Permute)
    return table


def pack(projection: Projection, features: list) -> Tables:
    """Lay out a projection for the compositor (detached: derivatives are passed by hand, see ``rasterize.py``)."""

    def shape(k: Kernels) -> list:
        ratios = k.ux * k.ux, k.ux * k.uy, dr.fma(k.uy, k.uy, k.vy * k.vy)
        return [k.ux, k.uy, k.vy, k.lo, *(dr.exp2(-2 * r) for r in ratios)]

    columns = [projection.x, projection.y, *shape(projection.kernels), *features]
    splats = _pack(columns, row_size(len(features)))
    if projection.pseudo is None:
        return Tables(splats, None, None, None)
    pseudo = _pack(shape(projection.pseudo), PSEUDO_ROW)
    dog_row, dog_index = (dr.detach(v, preserve_type=False) for v in (projection.dog_row, projection.dog_index))
    return Tables(splats, pseudo, dog_row, dog_index)


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
        self.grid, self.tables, self.lists = grid, tables, lists
        self.cutoffs, self.quads = settings.cutoffs, row_size(settings.n_features) // 4
        self.patch = settings.patch
        self.negative_transmittance = settings.negative_transmittance or tables.pseudo is None
        self.rises = tables.pseudo is not None and settings.negative_transmittance  # T may
        self.blocks = grid.blocks
        self.pixels = self.blocks.width * self.blocks.height
        tile, x, y = lanes
        self.begin = dr.gather(self.UInt, lists.begin, tile)
        self.end = dr.gather(self.UInt, lists.end, tile)
        self.x0, self.y0 = self.Float(x) + 0.5, self.Float(y) + 0.5
        columns = [(x + k) < grid.width for k in range(self.blocks.width)]
        row_ok = [(y + k) < grid.height for k in range(self.blocks.height)]
        self.inside = [r & c for r in row_ok for c in columns]
        base = y * grid.width + x
        self.at = [base + (r * grid.width + c) for r in range(self.blocks.height) for c in range(self.blocks.width)]
        self.stop_depth = None if tables.stop_depth is None else self.read(tables.stop_depth)

    # --- pixels in and out ---

    def start_T(self) -> list:
        """1 inside the image; pixels beyond its border are born dead (negative), so that they end no walk late."""
        return [dr.select(ok, self.Float(1), self.Float(-1)) for ok in self.inside]

    def read(self, plane) -> list:
        return [dr.gather(self.Float, plane, at, ok) for at, ok in zip(self.at, self.inside, strict=True)]

    def write(self, values: list) -> mi.Float:
        plane = dr.empty(self.Float, self.grid.width * self.grid.height)
        for value, at, ok in zip(values, self.at, self.inside, strict=True):
            dr.scatter(plane, value, at, ok, mode=dr.ReduceMode.Permute)
        return plane

    # --- one primitive ---

    def alive(self, T: list):
        """Some pixel still transmits: finished pixels carry -T."""
        return _largest(T) > 0

    def fetch(self, i, active) -> tuple:
        """(primitive, its row of the table, dx, dy) for entry ``i`` of the list; inactive lanes get an empty kernel."""
        splat = dr.gather(self.UInt, self.lists.splat_from_isect, i, active)
        row = []
        for k in range(self.quads):
            row += list(dr.gather(self.Quad, self.tables.splats, dr.fma(splat, self.quads, k), active))
        if active is not True:
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
                first = dr.select(p > DEAD_PATCH, dr.exp2(p), 0)
                right = dr.exp2(dr.minimum(-ux * dr.fma(2, u, ux), MAX_RATIO))
                down = dr.exp2(dr.minimum(dr.fma(-uy, dr.fma(2, u, uy), -vy * dr.fma(2, v, vy)), MAX_RATIO))
                for row in range(top, min(top + patch, height)):
                    value, ratio = first, right
                    for column in range(left, min(left + patch, width)):
                        values[row * width + column] = value
                        value, ratio = value * ratio, ratio * q
                    first, right, down = first * down, right * s, down * t
        return values

    def pseudo_kernel(self, splat, active, dx, dy) -> tuple:
        """2^p' of the pseudo-Gaussian, zeros for a plain primitive. All lanes of a packet take the same branch."""
        row = dr.gather(self.UInt, self.tables.dog_row, splat, active)
        is_dog = active & (row != NOT_DOG) if active is not True else row != NOT_DOG

        def evaluate(row, dx, dy):
            return self.kernel(*self.pseudo_row(row), dx, dy)

        def zeros(row, dx, dy):
            return [self.Float(0)] * self.pixels

        values = dr.if_stmt((row, dx, dy), is_dog, evaluate, zeros)
        return list(values), row, is_dog

    def pseudo_row(self, row) -> list:
        return [dr.gather(self.Float, self.tables.pseudo, dr.fma(row, PSEUDO_ROW, k)) for k in range(7)]

    def alphas(self, splat, row, active, dx, dy) -> tuple:
        """(α per pixel, primary values, pseudo values or None, its row, is_dog)."""
        primary = self.kernel(*row[2:FEATURES], dx, dy)
        if self.tables.pseudo is None:
            return [self._seen(dr.minimum(v, ALPHA_MAX)) for v in primary], primary, None, None, None
        pseudo, dog_row, is_dog = self.pseudo_kernel(splat, active, dx, dy)
        alpha = []
        for v, v_p in zip(primary, pseudo, strict=True):
            a = dr.minimum(v, ALPHA_MAX) - dr.minimum(v_p, ALPHA_MAX)
            alpha.append(self._seen(a))
        return alpha, primary, pseudo, dog_row, is_dog

    def _seen(self, alpha):
        size = alpha if self.tables.pseudo is None else dr.abs(alpha)
        return dr.select(size >= self.cutoffs.alpha, alpha, 0)

    def advance(self, alpha, T, row: Any = (), k: int = 0) -> tuple:
        """(weight α T of the primitive, T behind it, or -T where the walk has ended, whether it was blended)."""
        weight = alpha * T
        behind = T - (weight if self.negative_transmittance else dr.maximum(weight, 0))
        go = behind >= self.cutoffs.transmittance
        if self.rises:
            go &= behind <= MAX_T
        if self.stop_depth is not None:
            go &= row[FEATURES + 3] <= self.stop_depth[k]
        return dr.select(go, weight, 0), dr.select(go, behind, -dr.abs(T)), go


def _largest(values: list):
    while len(values) > 1:
        odd = values[len(values) // 2 * 2 :]
        values = [dr.maximum(a, b) for a, b in zip(values[::2], values[1::2], strict=False)] + odd
    return values[0]


@dr.freeze(warn_after=1 << 30)
def composite(grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings) -> tuple:
    """Blend. Returns (features: list of [H*W] planes, without background; T: [H*W] plane)."""
    walk, n_features = Walk(grid, lanes, tables, lists, settings), settings.n_features

    def body(i, T, C):
        T, C = list(T), list(C)
        for u in range(walk.blocks.unroll):
            active = (i + u) < walk.end if u else True
            splat, row, dx, dy = walk.fetch(i + u, active)
            alpha, *_ = walk.alphas(splat, row, active, dx, dy)
            for k in range(walk.pixels):
                weight, T[k], _ = walk.advance(alpha[k], T[k], row, k)
                for f in range(n_features):
                    C[f * walk.pixels + k] = dr.fma(weight, row[FEATURES + f], C[f * walk.pixels + k])
        return i + walk.blocks.unroll, T, C

    _, T, C = dr.while_loop(
        (walk.begin, walk.start_T(), [walk.Float(0)] * (n_features * walk.pixels)),
        lambda i, T, C: (i < walk.end) & walk.alive(T),
        body,
        labels=("i", "T", "C"),
        label="composite",
    )
    planes = [walk.write(C[f * walk.pixels : (f + 1) * walk.pixels]) for f in range(n_features)]
    return planes, walk.write([dr.abs(t) for t in T])
