"""A row of sums for every slot of the tile lists: how a walk adds up numbers per primitive.

On the CPU only the lanes of one tile add to a row; afterwards every primitive sums the rows of its slots. There is no
atomic addition, and so the result has the same bits in every run. On CUDA a primitive has one row, to which all lanes
add with atomics: a row for each isect would need atomics as well, for the lanes of its tile.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import drjit as dr
import mitsuba as mi
import numpy as np

from ..arrays import array_types, while_loop
from ..bands import PreparedView, WalkableView
from ..drjit_internals import llvm_packet
from ..frozen import zeros_for
from ..geometry import Blocks
from ..tiles import TileLists


class SlotRows:
    """Trace-time helper: the rows of a frozen function, zeros at first.

    They are made in it: rows that it is given and adds to Dr.Jit would copy first, 64 bytes per isect in every step.
    """

    def __init__(self, lists: TileLists, columns: int, in_turn: bool):
        """``in_turn``: ``lanes_add_in_turn``, which cannot be asked in a frozen function."""
        self.lists, self.columns, self.in_turn = lists, columns, in_turn
        each = lists.slot_begin if lists.one_slot_each else lists.slot_from_isect
        self.values = zeros_for(each, self.row_size)

    @property
    def row_size(self) -> int:
        """Floats: the columns and padding, for wide loads and wide scatters."""
        if self.lists.one_slot_each:
            return -(-self.columns // 4) * 4
        return max(4, 1 << (self.columns - 1).bit_length())

    def add(self, slot, values: list, active) -> None:
        """Add a value per column to the row ``slot``.

        One wide scatter instead of one per value. On CUDA the lanes of a warp that add to one row are joined first
        (``Local``). They ask each other once which of them do, if the row is a multiple of four floats: else Dr.Jit
        takes it apart, and they ask for each value (docs/performance/cuda.md).
        Never in mode ``Expand``, nor ``Auto`` which may choose it: they give every thread a copy of the table at an
        offset that a frozen kernel holds as a constant. Replayed with a larger table it writes out of bounds
        (Dr.Jit 1.5).
        """
        types = array_types()
        mode = dr.ReduceMode.NoConflicts if self.in_turn else dr.ReduceMode.Local
        padded = [*values, *[types.Float(0)] * (self.row_size - self.columns)]
        dr.scatter_add(self.values, types.Floats(padded), slot, active, mode=mode)

    def sums(self, splat=None, above: Sequence = ()) -> list:
        """The columns, summed over the slots of each primitive, or of the primitives ``splat``, for ``columns_of``.

        ``above``: what this returned for the bands above, with which the addition begins (``bands.py``).
        """
        types, lists = array_types(), self.lists
        if lists.one_slot_each:
            return [self.values]
        splat = dr.arange(types.UInt, dr.width(lists.slot_begin)) if splat is None else splat
        slot, end = (dr.gather(types.UInt, slots, splat) for slots in (lists.slot_begin, lists.slot_end))

        def body(slot, sums):
            row = _columns_at(self.values, slot, self.columns, self.row_size)
            return slot + 1, [s + v for s, v in zip(sums, row, strict=True)]

        start = slot, list(above) or [types.Float(0)] * self.columns
        return list(while_loop(start, lambda slot, sums: slot < end, body, "sum rows", ("slot", "sums"))[1])


def columns_of(sums: list, lists: TileLists, columns: int, splat=None) -> list:
    """What ``SlotRows.sums`` returned, as one array per column; where a primitive has one row, it is taken apart by the
    kernels that use it."""
    if not lists.one_slot_each:
        return sums
    splat = dr.arange(array_types().UInt, dr.width(lists.slot_begin)) if splat is None else splat
    return _columns_at(sums[0], splat, columns, dr.width(sums[0]) // dr.width(lists.slot_begin))


def _columns_at(table, row, columns: int, row_size: int) -> list:
    """The first ``columns`` of a row, four at a time."""
    values = []
    for k in range(-(-columns // 4)):
        values += list(dr.gather(array_types().Quad, table, dr.fma(row, row_size // 4, k)))
    return values[:columns]


def sums_over_bands(view: WalkableView, columns: int, walk: Callable[[PreparedView, bool, list], list]) -> list:
    """``columns`` sums of each primitive, [N] each, over a view.

    Args:
        walk: given a band, ``lanes_add_in_turn``, and what it returned for the bands above, returns
            ``SlotRows.sums(above=...)``; it may be frozen.
    """
    in_turn = lanes_add_in_turn(mi.variant())
    return view.walked(lambda band, above: columns_of(walk(band, in_turn, above), band.lists, columns), [])


@lru_cache
def lanes_add_in_turn(variant: str | None) -> bool:
    """Whether a wide ``scatter_add`` without atomics may meet the same row in all lanes of a tile.

    Dr.Jit does not promise it, but its LLVM backend (1.5) adds the lanes of a packet one after the other, which is a
    fifth faster than atomics with AVX-512 and twice as fast with AVX2. So it is tried, once per variant. If packets
    were narrower than a tile, two threads might share a tile's rows: no.
    """
    types, lanes, rows, columns = array_types(), Blocks.of_backend().lanes_per_tile, 64, 16
    if not types.is_llvm or llvm_packet() != lanes:
        return False
    lane = dr.arange(types.UInt, rows * lanes)
    table = dr.zeros(types.Float, rows * columns)
    values = [types.Float(lane % 7) + k for k in range(columns)]
    dr.scatter_add(table, types.Floats(values), lane // lanes, mode=dr.ReduceMode.NoConflicts)
    value = np.arange(rows * lanes).reshape(rows, lanes) % 7
    expected = value.sum(1)[:, None] + lanes * np.arange(columns)
    return np.array_equal(table.numpy().reshape(rows, columns), expected)
