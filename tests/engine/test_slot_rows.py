"""Rows of sums per primitive: how their columns are added at once."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.tiles import TileLists
from mi_dogsplat.engine.walks.slot_rows import SlotRows, columns_of


@pytest.mark.parametrize("columns", [1, 4, 9, 11, 22])
def test_where_a_primitive_has_one_row_all_lanes_add_to_it(columns):
    rng, n, lanes = np.random.default_rng(columns), 7, 500
    values = rng.uniform(0, 1, (columns, lanes)).astype(np.float32)
    slot, active = rng.integers(0, n, lanes).astype(np.uint32), rng.uniform(0, 1, lanes) < 0.8
    rows = one_row_each(n, columns)
    rows.add(array_types().UInt(slot), [array_types().Float(value) for value in values], mi.Bool(active))
    expected = np.zeros((n, columns))
    np.add.at(expected, slot[active], values.T[active])
    np.testing.assert_allclose(np.stack(columns_of(rows.sums(), rows.lists, columns), 1), expected, rtol=2e-6)


@pytest.mark.parametrize("columns", [1, 4, 9, 22])
def test_on_cuda_lanes_ask_each_other_once_for_all_columns(columns):
    types = array_types()
    if types.is_llvm:
        pytest.skip("LLVM adds without asking")
    rows, lane = one_row_each(7, columns), dr.arange(types.UInt, 100)
    dr.eval(rows.values)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        rows.add(lane // 16, [types.Float(lane) + k for k in range(columns)], lane % 5 != 0)
        dr.eval(rows.values)
        kernels = [kernel["ir"].getvalue() for kernel in dr.kernel_history() if "ir" in kernel]
    assert [kernel.count("match.any") for kernel in kernels] == [1]


def one_row_each(n: int, columns: int) -> SlotRows:
    """Of n primitives on a GPU, on whatever backend."""
    types = array_types()
    nothing, each = types.UInt(0), dr.opaque(types.UInt, 0, n)
    lists = TileLists(nothing, nothing, nothing, nothing, each, each, nothing, one_slot_each=True)
    return SlotRows(lists, columns, in_turn=False)
