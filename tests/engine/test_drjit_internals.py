"""What rests on the inside of Dr.Jit, which may change without notice."""

from importlib.metadata import version
from pathlib import Path
from typing import Any

import drjit as dr
import mi_dogsplat
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.engine.drjit_internals import DIGIT, argsort_small, digits_of, held, variable_indices

PACKAGE = Path(mi_dogsplat.__file__).parent
CHECKED = "1.5."
LOOK_AT = """what to look at in another version of Dr.Jit, before CHECKED is set to it:
engine/drjit_internals.py     block_mkperm and collect_indices of dr.detail: do they still do what the tests here say
engine/frozen.py              does garbage that is collected while a function is recorded still end the process;
                              are recordings still confused where an object comes twice among the arguments
walks/slot_rows.py            do lanes still add in turn (tried at run time); does mode Expand still hold an offset;
                              does a recorded kernel still keep its multiple of the lanes of what it reads
walks/walk.py                 is local memory still what aligns the stack (benchmarks floor says so)
plugin/transfer.py            does a branch still add the gradient of its arguments twice"""


def test_this_is_the_version_that_was_looked_into():
    assert version("drjit").startswith(CHECKED), LOOK_AT


def test_no_other_module_of_the_package_uses_what_is_not_documented():
    users = [path.name for path in PACKAGE.rglob("*.py") if "dr.detail." in path.read_text(encoding="utf-8")]
    assert users == ["drjit_internals.py"]


COUNTS = [1, 2, 7, 256, 257, 1000, 2200, 1 << 14, (1 << 14) + 1, 70_000]


@pytest.mark.parametrize("count", COUNTS)
def test_small_integers_are_sorted_and_equal_ones_keep_their_order(count):
    if not array_types().is_llvm:
        pytest.skip("on CUDA nothing is sorted: engine/tile_buckets.py")
    keys = np.random.default_rng(0).integers(0, count, 150_000).astype(np.uint32)
    order = argsort_small(array_types().UInt(keys), count).numpy()
    np.testing.assert_array_equal(order, np.argsort(keys, kind="stable"))


@pytest.mark.parametrize("largest", [3, DIGIT])
@pytest.mark.parametrize("count", COUNTS)
def test_digits_are_small_enough_and_cover_all_bits_in_turn(count, largest):
    bits, digits = digits_of(count, largest)
    assert count <= 1 << bits and (count <= 2 or count > 1 << (bits - 1))
    assert [first for first, _ in digits] == [0, *[last for _, last in digits[:-1]]] and digits[-1][1] == bits
    assert all(0 < last - first <= largest for first, last in digits)
    assert len(digits) == -(-bits // largest)


def test_the_indices_of_variables_change_when_one_is_replaced_or_attached():
    a, b = mi.Float(1, 2), mi.Float(3, 4)
    known = variable_indices([a, [b]])
    assert variable_indices([a, [b]]) == known
    assert variable_indices([a, [b + 1]]) != known
    dr.enable_grad(a)
    assert variable_indices([a, [b]]) != known


def test_what_is_held_stays_when_the_tensor_that_it_was_of_is_assigned_to():
    tensor: Any = dr.opaque(mi.TensorXf, 1, (6,))
    dr.enable_grad(tensor)
    view, (kept,) = tensor.array, held([tensor.array])
    index = view.index
    assert kept.index == index and not dr.grad_enabled(kept)
    tensor[:] = dr.zeros(mi.TensorXf, (6,))
    assert view.index != index and kept.index == index
    np.testing.assert_array_equal(kept.numpy(), np.ones(6))
