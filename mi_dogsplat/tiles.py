"""Stage 2, *tiles*: which primitives touch which tile, in depth order.

A primitive belongs to a tile when its level set {2^p >= cutoff} (for a DoG primitive: that of either kernel) meets the
span of the tile's pixel centres. The set is an ellipse; tile row by tile row its leftmost and rightmost points are
known in closed form, so no tile is listed that the ellipse does not enter ("AccuTile", Speedy-Splat 2024).
Entries are emitted in depth order and sorted by tile with a stable sort, which keeps that order inside each tile.
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .geometry import Cutoffs, Grid
from .project import NOT_DOG, Kernels, Projection


@dataclass
class Lists:
    """The primitives of each tile in depth order: ``splat_from_isect[begin[tile]:end[tile]]``.

    Entries are also numbered primitive by primitive, ``entry_begin[splat]`` to ``entry_end[splat]``.
    """

    splat_from_isect: mi.UInt32
    begin: mi.UInt32  # [tiles]
    end: mi.UInt32  # [tiles]
    entry_from_isect: mi.UInt32
    entry_begin: mi.UInt32  # [N]
    entry_end: mi.UInt32  # [N]


MAX_BUCKETS = 1 << 14  # of one counting pass
SLACK = 1e-3  # px, above the rounding error of the spans


class _Ellipses:
    """Level sets {p >= -log2_range} of kernels, one per lane: (ux dx + uy dy)² + (vy dy)² <= t."""

    def __init__(self, kernels: Kernels, log2_range: float, lookup=lambda v: v):
        def column(v):
            return lookup(dr.detach(v, preserve_type=False))

        self.width, self.vy = dr.rcp(column(kernels.ux)), column(kernels.vy)
        self.slope = -column(kernels.uy) * self.width  # dx of the ellipse's middle per dy
        self.t = column(kernels.lo) + log2_range
        self.seen = self.t > 0
        t = dr.maximum(self.t, 0)
        # half extents: sqrt(2 ln2 t Σ'_xx)
        self.extent_x = dr.sqrt(1.3862943611198906 * t * column(kernels.variance_x))
        self.extent_y = dr.sqrt(1.3862943611198906 * t * column(kernels.variance_y))
        # y of the rightmost point, Σ'_xy / Σ'_xx of its x; the leftmost is its mirror image
        covariance = self.slope * column(kernels.variance_y)
        self.y_right = covariance / column(kernels.variance_x) * self.extent_x

    def span(self, y0, y1) -> tuple:
        """Leftmost and rightmost dx of the ellipse within dy in [y0, y1]; (inf, -inf) where it misses the band."""
        y0, y1 = dr.maximum(y0, -self.extent_y), dr.minimum(y1, self.extent_y)
        meets = self.seen & (y0 <= y1)

        def side(y, sign):
            v = self.vy * y
            return dr.fma(self.slope, y, sign * self.width * dr.sqrt(dr.maximum(dr.fma(-v, v, self.t), 0)))

        right = side(dr.clip(self.y_right, y0, y1), 1)
        left = side(dr.clip(-self.y_right, y0, y1), -1)
        return dr.select(meets, left, dr.inf), dr.select(meets, right, -dr.inf)


class _Footprints:
    """Tile rows and, row by row, tile columns that a primitive covers."""

    def __init__(self, projection: Projection, grid: Grid, log2_range: float):
        self.Int = dr.int32_array_t(dr.detached_t(mi.Float))
        Float = dr.detached_t(mi.Float)
        self.x, self.y = (dr.detach(v, preserve_type=False) for v in (projection.x, projection.y))
        self.ellipses = [_Ellipses(projection.kernels, log2_range)]
        extent_y = dr.select(self.ellipses[0].seen, self.ellipses[0].extent_y, -1)
        if projection.pseudo is not None:
            row = dr.detach(projection.dog_row, preserve_type=False)
            is_dog = row != NOT_DOG
            other = _Ellipses(projection.pseudo, log2_range, lambda v: dr.gather(Float, v, row, is_dog))
            other.seen &= is_dog
            self.ellipses.append(other)
            extent_y = dr.maximum(extent_y, dr.select(other.seen, other.extent_y, -1))
        self.tiles_x, self.tiles_y = (dr.opaque(self.Int, v) for v in (grid.tiles_x, grid.tiles_y))
        visible = dr.detach(projection.visible, preserve_type=False) & (extent_y >= 0)
        self.tile_width, self.tile_height = grid.blocks.tile_width, grid.blocks.tile_height
        self.overlap = grid.blocks.overlap
        first, last = self._tile_range(self.y - extent_y, self.y + extent_y, self.tile_height, self.tiles_y)
        self.first = dr.select(visible, first, 0)
        self.last = dr.select(visible, last, 0)  # exclusive

    def _tile_range(self, low, high, size: int, count) -> tuple:
        """Tiles whose pixel centres (half a pixel inside their borders) meet [low, high], as [first, last)."""
        limit = dr.detached_t(mi.Float)(count)
        first = dr.ceil((low - SLACK - (size + self.overlap - 0.5)) * (1 / size))
        last = dr.floor((high + SLACK - 0.5) * (1 / size)) + 1
        return self.Int(dr.clip(first, 0, limit)), self.Int(dr.clip(last, 0, limit))

    def columns(self, row) -> tuple:
        """Tile columns [first, last) that the primitive covers in tile row ``row``."""
        y0 = dr.fma(type(self.x)(row), self.tile_height, 0.5 - SLACK) - self.y
        y1 = y0 + (self.tile_height + self.overlap - 1 + 2 * SLACK)
        left, right = self.ellipses[0].span(y0, y1)
        for other in self.ellipses[1:]:
            other_left, other_right = other.span(y0, y1)
            left, right = dr.minimum(left, other_left), dr.maximum(right, other_right)
        first, last = self._tile_range(self.x + left, self.x + right, self.tile_width, self.tiles_x)
        return first, dr.maximum(first, last)


def _argsort_small(key, count: int):
    """Stable argsort of integers below ``count``: one counting pass where the general radix sort needs three."""
    if count > MAX_BUCKETS:
        return dr.argsort(key)
    dr.eval(key)
    return dr.detail.block_mkperm(key, dr.width(key), count)


def tiles(projection: Projection, grid: Grid, cutoffs: Cutoffs) -> Lists:
    """Depth-ordered list of primitives per tile. Waits for the device once, to learn the length of the lists."""
    UInt = dr.detached_t(mi.UInt32)
    footprints = _Footprints(projection, grid, cutoffs.log2_range)

    def count_row(row, count):
        first, last = footprints.columns(row)
        return row + 1, count + UInt(last - first)

    _, counts = dr.while_loop(
        (footprints.first, UInt(0)), lambda row, count: row < footprints.last, count_row, label="count"
    )
    # positive floats sort like their bits
    depth_bits = dr.reinterpret_array(UInt, dr.detach(projection.depth, preserve_type=False))
    key = dr.select(counts > 0, depth_bits, 0xFFFFFFFF)
    dr.eval(key, counts)

    splat_from_rank = dr.argsort(key)  # [N] nearest first
    ends = dr.cumsum(dr.gather(UInt, counts, splat_from_rank))
    n_isects = int(ends[dr.width(ends) - 1]) if dr.width(ends) else 0
    begin, end = dr.zeros(UInt, grid.n_tiles), dr.zeros(UInt, grid.n_tiles)
    if n_isects == 0:
        nowhere = dr.zeros(UInt, dr.width(key))
        return Lists(dr.zeros(UInt, 1), begin, end, dr.zeros(UInt, 1), nowhere, nowhere)

    tile_from_isect, splat_from_isect = dr.empty(UInt, n_isects), dr.empty(UInt, n_isects)
    begin_from_rank = ends - dr.gather(UInt, counts, splat_from_rank)
    splat = dr.arange(UInt, dr.width(key))
    rank_begin = dr.empty(UInt, dr.width(key))
    dr.scatter(rank_begin, begin_from_rank, splat_from_rank, mode=dr.ReduceMode.Permute)

    def emit_row(row, at):
        first, last = footprints.columns(row)
        tile = UInt(dr.fma(row, footprints.tiles_x, first))

        def emit(column, tile, at):
            dr.scatter(tile_from_isect, tile, at)
            dr.scatter(splat_from_isect, splat, at)
            return column + 1, tile + 1, at + 1

        _, _, at = dr.while_loop((first, tile, at), lambda column, tile, at: column < last, emit, label="emit")
        return row + 1, at

    dr.while_loop((footprints.first, rank_begin), lambda row, at: row < footprints.last, emit_row, label="emit rows")

    order = _argsort_small(tile_from_isect, grid.n_tiles)
    tile = dr.gather(UInt, tile_from_isect, order)
    i = dr.arange(UInt, n_isects)
    count = dr.opaque(UInt, n_isects)  # a literal would compile a kernel per frame
    dr.eval(tile)
    before = dr.gather(UInt, tile, i - 1, i > 0)
    after = dr.gather(UInt, tile, i + 1, i + 1 < count)
    dr.scatter(begin, i, tile, (i == 0) | (before != tile))
    dr.scatter(end, i + 1, tile, (i + 1 == count) | (after != tile))
    splats = dr.gather(UInt, splat_from_isect, order)
    return Lists(splats, begin, end, order, rank_begin, rank_begin + counts)
