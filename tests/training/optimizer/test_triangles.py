"""Triangles of matrices, as they are kept on the device."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.arrays import array_types, detached
from mi_dogsplat.training.optimizer.triangles import entries_of, kept_of, n_pairs, to_host, upload


@pytest.mark.parametrize("n", [1, 7, 40])
def test_entries_are_the_same_on_the_host_in_a_kernel_and_kept_again(n):
    values = np.random.default_rng(n).normal(size=(n_pairs(3), n)).astype(np.float32)
    kept = upload(values)
    assert len(kept) == (6 if array_types().is_llvm else 1)
    np.testing.assert_array_equal(to_host(kept, n_pairs(3)), values)
    entries = entries_of(kept, n)
    np.testing.assert_array_equal(np.stack([entry.numpy() for entry in entries]), values)
    again = kept_of([detached(mi.Float(entry) * 2) for entry in entries], n)
    dr.eval(again)
    np.testing.assert_array_equal(to_host(again, n_pairs(3)), 2 * values)


def test_a_row_begins_where_the_rows_above_it_end():
    assert [n_pairs(d) for d in range(5)] == [0, 1, 3, 6, 10]
