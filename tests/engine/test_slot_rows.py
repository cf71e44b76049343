"""Rows of sums per primitive: how their columns are added at once."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.tiles import TileLists
from mi_dogsplat.engine.walks.slot_rows import SlotRows, columns_of, packets


@pytest.mark.parametrize("columns", range(1, 30))
def test_packets_hold_each_column_once_and_begin_where_a_wide_scatter_may(columns):
    found = packets(columns)
    assert [first + k for first, size in found for k in range(size)] == list(range(columns))
    assert all(size in (1, 2, 4) and first % size == 0 for first, size in found)


@pytest.mark.parametrize("columns", [1, 4, 9, 11, 22])
def test_where_a_primitive_has_one_row_all_lanes_add_to_it(columns):
    rng, types, n, lanes = np.random.default_rng(columns), array_types(), 7, 500
    values = rng.uniform(0, 1, (columns, lanes)).astype(np.float32)
    slot, active = rng.integers(0, n, lanes).astype(np.uint32), rng.uniform(0, 1, lanes) < 0.8
    nothing, each = types.UInt(0), dr.opaque(types.UInt, 0, n)
    lists = TileLists(nothing, nothing, nothing, nothing, each, each, nothing, one_slot_each=True)
    rows = SlotRows(lists, columns, in_turn=False)
    rows.add(types.UInt(slot), [types.Float(value) for value in values], mi.Bool(active))
    expected = np.zeros((n, columns))
    np.add.at(expected, slot[active], values.T[active])
    np.testing.assert_allclose(np.stack(columns_of(rows.sums(), lists, columns), 1), expected, rtol=2e-6)
