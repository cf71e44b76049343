"""A row of sums for every isect of the tile lists: how a walk adds up numbers per primitive.

Only the lanes of one tile add to a row; afterwards every primitive sums the rows of its slots. There is no atomic
addition, and so the result has the same bits in every run.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..arrays import array_types, while_loop
from ..drjit_internals import llvm_packet
from ..geometry import Blocks
from ..tiles import TileLists


@dataclass
class SlotRows:
    """An argument of the kernel that adds to it: a frozen function cannot allocate what depends on the lists."""

    values: Any  # Float [slots, row_size], zeros at first
    columns: int
    in_turn: bool  # ``lanes_add_in_turn``

    @staticmethod
    def zeros(lists: TileLists, columns: int) -> SlotRows:
        size = lists.n_isects * _row_size(columns)
        return SlotRows(dr.zeros(array_types().Float, size), columns, lanes_add_in_turn(mi.variant()))

    @property
    def row_size(self) -> int:
        return _row_size(self.columns)

    def add(self, slot, values: list, active) -> None:
        """Add a value per column to the row ``slot``, the same one in all lanes of a tile.

        One wide scatter instead of one per value. Never in mode ``Expand``, nor ``Auto`` which may choose it: they give
        every thread a copy of the table at an offset that a frozen kernel holds as a constant. Replayed with a larger
        table it writes out of bounds (Dr.Jit 1.5).
        """
        types = array_types()
        padded = [*values, *[types.Float(0)] * (self.row_size - self.columns)]
        mode = dr.ReduceMode.NoConflicts if self.in_turn else dr.ReduceMode.Local
        dr.scatter_add(self.values, types.Floats(padded), slot, active, mode=mode)

    def sums(self, lists: TileLists, splat=None, above: list | None = None) -> list:
        """The columns, summed over the slots of each primitive, or of the primitives ``splat``.

        ``above``: their sums over the bands above, with which the addition begins.
        """
        types = array_types()
        splat = dr.arange(types.UInt, dr.width(lists.slot_begin)) if splat is None else splat
        slot, end = (dr.gather(types.UInt, slots, splat) for slots in (lists.slot_begin, lists.slot_end))

        def body(slot, sums):
            values = []
            for k in range(-(-self.columns // 4)):
                values += list(dr.gather(types.Quad, self.values, dr.fma(slot, self.row_size // 4, k)))
            return slot + 1, [s + v for s, v in zip(sums, values, strict=False)]

        start = slot, above or [types.Float(0)] * self.columns
        return list(while_loop(start, lambda slot, sums: slot < end, body, "sum rows", ("slot", "sums"))[1])


def _row_size(columns: int) -> int:
    """Floats: the columns and padding up to a power of two, for wide loads and scatters."""
    return max(4, 1 << (columns - 1).bit_length())


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
