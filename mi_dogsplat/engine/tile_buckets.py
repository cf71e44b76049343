"""The lists of the tiles on CUDA: isects fall into buckets, and find their place in their bucket by comparing.

A sort of Dr.Jit takes six launches for each digit of 8 bits on CUDA: 24 by depth and 12 by tile. Here there are five.
A bucket is a tile and a range of depths: of all depths that are seen, on nearly a logarithmic scale, a ``DEPTHS``-th.
Isects are counted in their buckets, the sum of these numbers says where each bucket begins, isects are written into
their buckets in any order (atomics), and then each counts those of its bucket that come before it: some, unless very
many primitives in a tile have nearly the same depth. So the lists are exact, and the same in every run.

A primitive's rows of tiles are shared out to ``ROWS_AT_ONCE`` lanes, so that none is alone with a primitive that covers
the image.

What visits the tiles is frozen: a GPU waits while it is traced.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import drjit as dr

from .arrays import array_types, constant, while_loop
from .footprints import Footprints
from .frozen import frozen, zeros_for
from .geometry import Blocks, Grid

ROWS_AT_ONCE = 8  # lanes per primitive
DEPTHS = 256  # buckets of a tile


@dataclass
class Buckets:
    """``ends[b]`` is behind the last isect of bucket b; those of a tile are neighbours, from its nearest on."""

    ends: Any
    splat: Any  # of each isect, in the order of the lists
    masks: Any  # as long as asked for

    def of_tile(self, tile: Any) -> tuple:
        """Isects [begin, end) of a tile."""
        UInt = array_types().UInt
        last = dr.fma(tile, DEPTHS, DEPTHS - 1)
        return _begin(self.ends, tile * DEPTHS), dr.gather(UInt, self.ends, last)


def sort_into_buckets(footprints: Footprints, depth_bits: Any, grid: Grid, padded: int) -> Buckets | None:
    """Isects by tile, then depth, then primitive; None where there is none.

    Evaluates the footprints with what is scheduled, and waits for the device once.

    Args:
        depth_bits: [N] bits of the depths.
        padded: ``masks`` gets a multiple of this as its length.
    """
    UInt = array_types().UInt
    ends_of_depths = dr.zeros(UInt, 2)  # of the nearest, flipped, so that it is a largest too, and of the farthest
    for k, bits in enumerate((~depth_bits, depth_bits)):
        seen = footprints.first < footprints.last
        dr.scatter_reduce(dr.ReduceOp.Max, ends_of_depths, bits, k, seen, mode=dr.ReduceMode.Local)
    dr.eval(depth_bits, footprints.kept(), ends_of_depths)
    # a literal that is gathered from is copied first
    given = footprints.kept(), footprints.tiles_x, grid.blocks, depth_bits, ends_of_depths, constant(UInt, "first", 0)
    rows = _Given(*given, _lanes(dr.width(depth_bits)))
    ends = _counted(rows, grid.n_tiles)
    n_isects = int(ends[dr.width(ends) - 1])
    if n_isects == 0:
        return None
    ends, entries = _written(rows, ends, dr.opaque(dr.cuda.UInt8, 0, n_isects))
    return Buckets(ends, *_in_order(entries, ends, n_isects, padded))


@lru_cache(maxsize=2)
def _lanes(n: int) -> Any:
    """A zero for each lane of ``n`` primitives. A frozen kernel has as many lanes as what it reads, or a multiple: with
    nothing of this size it takes the multiple of something else, and then a wrong number (Dr.Jit 1.5)."""
    return dr.opaque(dr.cuda.UInt8, 0, n * ROWS_AT_ONCE)


@dataclass(frozen=True)
class _Given:
    """What the rows of tiles of the primitives are made of, for frozen functions; ``first`` is a zero."""

    footprints: list
    tiles_x: Any
    blocks: Blocks
    depth_bits: Any
    ends_of_depths: Any
    first: Any
    lanes: Any


@frozen
def _counted(given: _Given, n_tiles: int) -> Any:
    """Where buckets begin, and last, the end of the last one."""
    # one too many, and each number one further than its bucket
    numbers = dr.zeros(array_types().UInt, n_tiles * DEPTHS + 1)
    _Rows(given).for_each_tile(lambda bucket, *_: dr.scatter_add(numbers, 1, bucket + 1), "count")
    return dr.cumsum(numbers)


@frozen
def _written(given: _Given, ends: Any, isects: Any) -> tuple:
    """(ends of the buckets that begin at ``ends``, their isects in any order).

    Args:
        isects: a zero for each. An array for them to be written to would be copied first, or, not evaluated, lead to
            another recording for each number of isects (Dr.Jit 1.5).
    """
    rows, entries = _Rows(given), zeros_for(isects, 4, array_types().UInt)

    def emit(bucket, column, blocks):
        entry = array_types().UIntQuad(rows.bits, rows.splat, bucket, rows.footprints.lane_mask(blocks, column))
        dr.scatter(entries, entry, dr.scatter_inc(ends, bucket))

    rows.for_each_tile(emit, "emit")
    return ends, entries


class _Rows:
    """Trace-time helper: every ``ROWS_AT_ONCE``-th row of tiles of a primitive, one lane each."""

    def __init__(self, given: _Given):
        types = array_types()
        self.UInt, self.Int = types.UInt, types.Int
        lane = dr.arange(self.UInt, dr.width(given.lanes)) + self.UInt(given.lanes)
        self.splat, self.first = lane // ROWS_AT_ONCE, self.Int(lane % ROWS_AT_ONCE)
        self.bits = dr.gather(self.UInt, given.depth_bits, self.splat)
        self.footprints = Footprints.of(given.footprints, given.tiles_x, given.blocks).at(self.splat)
        flipped, farthest = dr.gather(types.UIntPair, given.ends_of_depths, given.first)
        scale = DEPTHS / (types.Float(farthest - ~flipped) + 1)
        self.depth = dr.minimum(self.Int(types.Float(self.bits - ~flipped) * scale), DEPTHS - 1)

    def for_each_tile(self, visit: Callable[[Any, Any, list], Any], label: str) -> None:
        """Call ``visit`` with the bucket of each isect, its column of tiles, and ``Footprints.block_columns`` there."""
        f = self.footprints

        def in_row(row):
            first, last = f.columns(row)
            blocks = f.block_columns(row)

            def in_column(column):
                tile = dr.fma(row, f.tiles_x, column)
                visit(self.UInt(dr.fma(tile, DEPTHS, self.depth)), column, blocks)
                return (column + 1,)

            while_loop((first,), lambda column: column < last, in_column, label)
            return (row + ROWS_AT_ONCE,)

        while_loop((f.first + self.first,), lambda row: row < f.last, in_row, f"{label} rows")


def _in_order(entries: Any, ends: Any, n_isects: int, padded: int) -> tuple:
    """(primitive, mask) of the entries (depth, primitive, bucket, mask), each bucket in order."""
    types = array_types()
    UInt = types.UInt
    bits, splat, bucket, mask = dr.gather(types.UIntQuad, entries, dr.arange(UInt, n_isects))
    begin = _begin(ends, bucket)

    def compare(other, place):
        other_bits, other_splat = dr.gather(types.UIntPair, entries, other * 2)
        before = (other_bits < bits) | ((other_bits == bits) & (other_splat < splat))
        return other + 1, place + dr.select(before, UInt(1), 0)

    end = dr.gather(UInt, ends, bucket)
    _, place = while_loop((begin, begin), lambda other, place: other < end, compare, "order")
    splats, masks = dr.empty(UInt, n_isects), dr.empty(UInt, -(-n_isects // padded) * padded)
    dr.scatter(splats, splat, place, mode=dr.ReduceMode.Permute)
    dr.scatter(masks, mask, place, mode=dr.ReduceMode.Permute)
    dr.eval(splats, masks)
    return splats, masks


def _begin(ends: Any, bucket: Any) -> Any:
    """Where a bucket begins: at the end of the one before it."""
    UInt = array_types().UInt
    return dr.select(bucket > 0, dr.gather(UInt, ends, bucket - 1, bucket > 0), 0)
