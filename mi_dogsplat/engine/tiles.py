"""Stage 2, *tiles*: which primitives touch which tile, in depth order, and which of its lanes they touch.

An *isect* is a tile and a primitive that touches it. Isects are emitted primitive by primitive, in depth order, each
with a mask of the lanes whose blocks the primitive covers (``footprints.py``), and sorted by tile with a stable sort,
which keeps the depth order inside of each tile. Its place before the sort is the isect's *slot*. Transposed, the masks
tell each lane which isects of its tile it has to look at: about half of them, a quarter where primitives are small.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from .arrays import array_types, while_loop
from .drjit_internals import argsort_small
from .footprints import Footprints
from .geometry import Blocks, Cutoffs, Grid, Lanes
from .isects import Isects, count_isects, depth_bits
from .project import Projection
from .rows import NO_ROW
from .tile_buckets import sort_into_buckets

WORD, AT_ONCE = 32, 8  # bits of a word, and how many masks are read at once


@dataclass
class TileLists:
    """The primitives of each tile in depth order: ``splat_from_isect[begin[tile]:end[tile]]``.

    The slots of a primitive's isects are neighbours, ``slot_begin[splat]`` to ``slot_end[splat]``.

    ``words``: bit b of ``words[tile + g, lane]`` says whether isect 32 g + b is one of the lane's. A tile that begins
    between two multiples of 32 has a word of its own for what follows: so tile and g together tell where a word is.
    """

    splat_from_isect: mi.UInt32
    begin: mi.UInt32  # [tiles]
    end: mi.UInt32  # [tiles]
    slot_from_isect: mi.UInt32
    slot_begin: mi.UInt32  # [N]
    slot_end: mi.UInt32  # [N]
    words: mi.UInt32  # [tiles + isects / 32, lanes per tile]
    one_slot_each: bool = False  # a primitive's isects share one slot, which is its number
    dog: mi.UInt32 | None = None  # [tiles], 1 where a primitive is DoG, 0 elsewhere; None where too many are

    @property
    def n_isects(self) -> int:
        """At least 1: empty lists have one that is nobody's."""
        return dr.width(self.splat_from_isect)


def tiles(projection: Projection, grid: Grid, cutoffs: Cutoffs, isects: Isects | None = None) -> TileLists:
    """Depth-ordered list of primitives per tile. Waits for the device once, to learn the length of the lists.

    ``isects``: those of LLVM, where they have been counted.
    """
    if array_types().is_llvm:
        return list_isects(isects or count_isects(projection, grid, cutoffs), grid.blocks, grid.lanes)
    return _bucket_lists(Footprints(projection, grid, cutoffs.log2_range), depth_bits(projection), grid)


def list_isects(isects: Isects, blocks: Blocks, lanes: Lanes) -> TileLists:
    """What has been counted, as lists: of all tiles, or of the tile rows of ``lanes``, whose first tile is number 0.

    A sort by depth and a counting sort by tile, which is few passes on the CPU.
    """
    n_splats, n_tiles = dr.width(isects.counts), dr.width(lanes.tile) // blocks.lanes_per_tile
    if isects.total == 0:
        return _no_lists(n_splats, n_tiles)
    UInt = array_types().UInt
    slot_begin, slot_end = _slots(isects)
    tile_from_slot, splat_and_mask = _emitted(isects, slot_begin)
    slot_from_isect = argsort_small(tile_from_slot, n_tiles)
    tile_from_isect = dr.gather(UInt, tile_from_slot, slot_from_isect)
    dr.eval(tile_from_isect, slot_from_isect)
    begin, end = _ranges(tile_from_isect, n_tiles)
    splat_from_isect, masks = _sorted(splat_and_mask, slot_from_isect)
    dog = None if isects.dog_row is None else _dog_tiles(isects.dog_row, tile_from_isect, splat_from_isect, n_tiles)
    dr.eval(begin, end, splat_from_isect, masks, dog)
    first, last = (dr.gather(UInt, ends, lanes.tile) for ends in (begin, end))
    words = _lane_words(lanes, blocks, masks, first, last)
    return TileLists(splat_from_isect, begin, end, slot_from_isect, slot_begin, slot_end, words, dog=dog)


def _slots(isects: Isects) -> tuple:
    """[N] first slot of each primitive, and the one behind its last: slots are given out in the order of depth."""
    UInt, rank = array_types().UInt, isects.splat_from_rank
    begin_from_rank = isects.ends - dr.gather(UInt, isects.counts, rank)
    slot_begin, slot_end = dr.empty(UInt, dr.width(isects.counts)), dr.empty(UInt, dr.width(isects.counts))
    dr.scatter(slot_begin, begin_from_rank, rank, mode=dr.ReduceMode.Permute)
    dr.scatter(slot_end, isects.ends, rank, mode=dr.ReduceMode.Permute)
    return slot_begin, slot_end


def _emitted(isects: Isects, slot_begin: Any) -> tuple:
    """(tile of each slot; pairs of its primitive and its mask of lanes)"""
    types, footprints = array_types(), isects.footprints
    UInt = types.UInt
    new = dr.zeros if isects.blank else dr.empty  # what is blank is in no lane of the first tile
    tile_from_slot, splat_and_mask = new(UInt, isects.total), new(UInt, 2 * isects.total)
    splat = dr.arange(UInt, dr.width(slot_begin))

    def emit_row(row, slot):
        first, last = footprints.columns(row)
        block_columns = footprints.block_columns(row)
        tile = UInt(dr.fma(row - footprints.top, footprints.tiles_x, first))

        def emit(column, tile, slot):
            dr.scatter(tile_from_slot, tile, slot)
            dr.scatter(splat_and_mask, types.UIntPair(splat, footprints.lane_mask(block_columns, column)), slot)
            return column + 1, tile + 1, slot + 1

        _, _, slot = while_loop((first, tile, slot), lambda column, tile, slot: column < last, emit, "emit")
        return row + 1, slot

    while_loop((footprints.first, slot_begin), lambda row, slot: row < footprints.last, emit_row, "emit rows")
    return tile_from_slot, splat_and_mask


def _ranges(tile_from_isect: Any, n_tiles: int) -> tuple:
    """[tiles] first isect of each tile, and the one behind its last: they are where its neighbours are of other tiles.
    Both are 0 where it has none."""
    UInt, n_isects = array_types().UInt, dr.width(tile_from_isect)
    i = dr.arange(UInt, n_isects)
    count = dr.opaque(UInt, n_isects)  # a literal would compile a kernel per frame
    before = dr.gather(UInt, tile_from_isect, i - 1, i > 0)
    after = dr.gather(UInt, tile_from_isect, i + 1, i + 1 < count)
    begin, end = dr.zeros(UInt, n_tiles), dr.zeros(UInt, n_tiles)
    dr.scatter(begin, i, tile_from_isect, (i == 0) | (before != tile_from_isect))
    dr.scatter(end, i + 1, tile_from_isect, (i + 1 == count) | (after != tile_from_isect))
    return begin, end


def _sorted(splat_and_mask: Any, slot_from_isect: Any) -> tuple:
    """(primitive of each isect; masks, of a multiple of ``WORD``), from the pairs of the slots."""
    types, n_isects = array_types(), dr.width(slot_from_isect)
    i = dr.arange(types.UInt, n_isects)
    splat, mask = dr.gather(types.UIntPair, splat_and_mask, slot_from_isect)
    splat_from_isect = dr.empty(types.UInt, n_isects)  # evaluated itself, it would keep what it is gathered from (1.5)
    dr.scatter(splat_from_isect, splat, i, mode=dr.ReduceMode.Permute)
    masks = dr.empty(types.UInt, -(-n_isects // WORD) * WORD)  # what is behind the last isect is nobody's
    dr.scatter(masks, mask, i, mode=dr.ReduceMode.Permute)
    return splat_from_isect, masks


def _dog_tiles(dog_row: Any, tile_from_isect: Any, splat_from_isect: Any, n_tiles: int) -> Any:
    """``TileLists.dog``."""
    UInt = array_types().UInt
    found = dr.zeros(UInt, n_tiles)
    is_dog = dr.gather(UInt, dog_row, splat_from_isect) != NO_ROW
    dr.scatter(found, UInt(1), tile_from_isect, is_dog)
    return found


def _bucket_lists(footprints: Footprints, depth_bits: Any, grid: Grid) -> TileLists:
    """Without a sort, which takes many launches on CUDA."""
    UInt, lanes_per_tile = array_types().UInt, grid.blocks.lanes_per_tile
    slot_begin = dr.arange(UInt, dr.width(depth_bits))
    slot_end = slot_begin + 1
    dr.schedule(slot_begin, slot_end)
    buckets = sort_into_buckets(footprints, depth_bits, grid, WORD)
    if buckets is None:
        return _no_lists(dr.width(depth_bits), grid.n_tiles)
    begin, end = dr.empty(UInt, grid.n_tiles), dr.empty(UInt, grid.n_tiles)
    tile = grid.lanes.tile
    first, last = buckets.of_tile(tile)
    leads = dr.arange(UInt, dr.width(tile)) % lanes_per_tile == 0
    dr.scatter(begin, first, tile, leads, mode=dr.ReduceMode.Permute)
    dr.scatter(end, last, tile, leads, mode=dr.ReduceMode.Permute)
    words = _lane_words(grid.lanes, grid.blocks, buckets.masks, first, last)
    return TileLists(buckets.splat, begin, end, buckets.splat, slot_begin, slot_end, words, one_slot_each=True)


def _no_lists(n: int, n_tiles: int) -> TileLists:
    """Where nothing is seen. No literals: with these a frozen function reads no array whose size follows the model, and
    replays what it recorded for another size."""
    types = array_types()
    begin, end, nowhere, none = (dr.opaque(types.UInt, 0, size) for size in (n_tiles, n_tiles, n, 1))
    return TileLists(none, begin, end, none, nowhere, nowhere, none, one_slot_each=not types.is_llvm)


def _lane_words(lanes: Lanes, blocks: Blocks, masks: Any, begin: Any, end: Any) -> Any:
    """The ``words`` of ``TileLists``, evaluated: from a bit per lane, for every isect, to a bit per isect, for every
    lane.

    Args:
        masks: as many as fill words; those of isects that are nobody's may be anything.
        begin, end: isects of each lane's tile.
    """
    types, tile, lanes_per_tile = array_types(), lanes.tile, blocks.lanes_per_tile
    n_tiles, n_groups = dr.width(tile) // lanes_per_tile, dr.width(masks) // WORD
    words = dr.empty(types.UInt, (n_tiles + n_groups) * lanes_per_tile)
    lane = dr.arange(types.UInt, dr.width(tile)) % lanes_per_tile

    def one_word(group):
        word = types.UInt(0)
        for k in range(0, WORD, AT_ONCE):
            index = group * (WORD // AT_ONCE) + k // AT_ONCE
            several = dr.gather(types.UInts, masks, index, shape=(AT_ONCE, dr.width(group)))
            for b, mask in enumerate(several, k):
                word |= ((mask >> lane) & 1) << b
        # at both ends of the list there are isects of other tiles
        first = group * WORD
        word &= types.UInt(0xFFFFFFFF) << dr.select(begin > first, begin - first, 0)
        word &= types.UInt(0xFFFFFFFF) >> (WORD - dr.minimum(end - first, WORD))
        dr.scatter(words, word, (tile + group) * lanes_per_tile + lane)
        return (group + 1,)

    last = dr.select(begin < end, (end - 1) // WORD + 1, 0)
    while_loop((begin // WORD,), lambda group: group < last, one_word, "lanes", ("group",))
    dr.eval(words)
    return words
