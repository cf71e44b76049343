"""Stage 2, *tiles*: which primitives touch which tile, in depth order, and which of its lanes they touch.

Entries are emitted in depth order and sorted by tile with a stable sort, which keeps that order inside each tile. With
an entry goes a bit set of the lanes whose blocks the primitive covers (``footprints.py``). Transposed, the bits tell
each lane which entries of its tile it has to look at: about half of them, and a quarter where primitives are small.
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .footprints import Footprints
from .geometry import Blocks, Cutoffs, Grid
from .project import Projection


@dataclass
class Lists:
    """The primitives of each tile in depth order: ``splat_from_isect[begin[tile]:end[tile]]``.

    Entries are also numbered primitive by primitive, ``entry_begin[splat]`` to ``entry_end[splat]``.

    ``words``: bit b of ``words[tile + g, lane]`` says whether entry 32 g + b is one of the lane's. A tile that begins
    between two multiples of 32 has a word of its own for what follows: so tile and g together tell where a word is.
    """

    splat_from_isect: mi.UInt32
    begin: mi.UInt32  # [tiles]
    end: mi.UInt32  # [tiles]
    entry_from_isect: mi.UInt32
    entry_begin: mi.UInt32  # [N]
    entry_end: mi.UInt32  # [N]
    words: mi.UInt32  # [tiles + entries / 32, lanes]


MAX_BUCKETS = 1 << 14  # of one counting pass
WORD, PACKET = 32, 8  # bits of a word, and how many entries are read at once


def _argsort_small(key, count: int):
    """Stable argsort of integers below ``count``: one counting pass where the general radix sort needs three."""
    if count > MAX_BUCKETS:
        return dr.argsort(key)
    dr.eval(key)
    return dr.detail.block_mkperm(key, dr.width(key), count)


def tiles(projection: Projection, grid: Grid, cutoffs: Cutoffs) -> Lists:
    """Depth-ordered list of primitives per tile. Waits for the device once, to learn the length of the lists."""
    UInt = dr.detached_t(mi.UInt32)
    footprints = Footprints(projection, grid, cutoffs.log2_range)

    def count_row(row, count):
        first, last = footprints.columns(row)
        return row + 1, count + UInt(last - first)

    _, counts = dr.while_loop(
        (footprints.first, UInt(0)), lambda row, count: row < footprints.last, count_row, label="count"
    )
    # positive floats sort like their bits
    depth_bits = dr.reinterpret_array(UInt, dr.detach(projection.depth, preserve_type=False))
    key = dr.select(counts > 0, depth_bits, 0xFFFFFFFF)
    dr.eval(key, counts, footprints.kept())  # or the projection would be computed again where entries are emitted

    splat_from_rank = dr.argsort(key)  # [N] nearest first
    ends = dr.cumsum(dr.gather(UInt, counts, splat_from_rank))
    n_isects = int(ends[dr.width(ends) - 1]) if dr.width(ends) else 0
    begin, end = dr.zeros(UInt, grid.n_tiles), dr.zeros(UInt, grid.n_tiles)
    if n_isects == 0:
        nowhere = dr.zeros(UInt, dr.width(key))
        return Lists(dr.zeros(UInt, 1), begin, end, dr.zeros(UInt, 1), nowhere, nowhere, dr.zeros(UInt, 1))

    Pair = dr.llvm.Array2u if dr.backend_v(UInt) == dr.JitBackend.LLVM else dr.cuda.Array2u
    tile_from_isect, splat_and_lanes = dr.empty(UInt, n_isects), dr.empty(UInt, 2 * n_isects)
    begin_from_rank = ends - dr.gather(UInt, counts, splat_from_rank)
    splat = dr.arange(UInt, dr.width(key))
    rank_begin = dr.empty(UInt, dr.width(key))
    dr.scatter(rank_begin, begin_from_rank, splat_from_rank, mode=dr.ReduceMode.Permute)

    def emit_row(row, at):
        first, last = footprints.columns(row)
        block_columns = footprints.block_columns(row)
        tile = UInt(dr.fma(row, footprints.tiles_x, first))

        def emit(column, tile, at):
            dr.scatter(tile_from_isect, tile, at)
            dr.scatter(splat_and_lanes, Pair(splat, footprints.lanes(block_columns, column)), at)
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
    splats, its_lanes = dr.gather(Pair, splat_and_lanes, order)
    n_words = -(-n_isects // WORD)
    lanes = dr.empty(UInt, n_words * WORD)  # read in packets; what is behind the last entry is nobody's
    dr.scatter(lanes, its_lanes, i, mode=dr.ReduceMode.Permute)
    dr.eval(begin, end, splats, lanes)
    words = dr.empty(UInt, (grid.n_tiles + n_words) * grid.blocks.lanes)
    transpose_lanes(grid.lanes[0], grid.blocks, lanes, begin, end, words)
    return Lists(splats, begin, end, order, rank_begin, rank_begin + counts, words)


def transpose_lanes(tile, blocks: Blocks, lanes, begin, end, words) -> None:
    """From a bit per lane, for every entry, to a bit per entry, for every lane: the ``words`` of ``Lists``."""
    UInt = type(begin)
    begin, end = dr.gather(UInt, begin, tile), dr.gather(UInt, end, tile)
    lane = dr.arange(UInt, dr.width(tile)) % blocks.lanes
    Packet = dr.llvm.ArrayXu if dr.backend_v(UInt) == dr.JitBackend.LLVM else dr.cuda.ArrayXu

    def one_word(group):
        word = UInt(0)
        for k in range(0, WORD, PACKET):
            packet = dr.gather(Packet, lanes, group * (WORD // PACKET) + k // PACKET, shape=(PACKET, dr.width(group)))
            for b, bits in enumerate(packet, k):
                word |= ((bits >> lane) & 1) << b
        # at both ends of the list there are entries of other tiles
        first = group * WORD
        word &= UInt(0xFFFFFFFF) << dr.select(begin > first, begin - first, 0)
        word &= UInt(0xFFFFFFFF) >> (WORD - dr.minimum(end - first, WORD))
        dr.scatter(words, word, (tile + group) * blocks.lanes + lane)
        return (group + 1,)

    last = dr.select(begin < end, (end - 1) // WORD + 1, 0)
    dr.while_loop((begin // WORD,), lambda group: group < last, one_word, labels=("group",), label="lanes")
    dr.eval(words)
