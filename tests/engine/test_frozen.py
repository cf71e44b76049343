"""Frozen functions: garbage that Dr.Jit could not free meanwhile waits."""

import gc
import itertools
import subprocess
import sys
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.frozen import KINDS_KEPT, described, frozen, frozen_for_sizes

# A function that allocates enough to collect garbage, which is there: cycles of what must not be freed meanwhile.
WITH_GARBAGE = """
import gc, itertools, sys
import mi_dogsplat, drjit as dr, mitsuba as mi, numpy as np
from mi_dogsplat.engine.frozen import frozen

mi.set_variant("llvm_ad_rgb")
traced = itertools.count()

@frozen
def increased(x):
    next(traced)
    kept = [[] for _ in range(100_000)]
    return x + len(kept)

def make_garbage():
    garbage = [mi.Float(np.zeros(1000, np.float32)) if sys.argv[1] == "array" else mi.load_dict({"type": "scene"})]
    garbage.append(garbage)

x = dr.arange(mi.Float, 3)
gc.collect()
gc.set_threshold(50_000, 10, 10)
make_garbage()
assert increased(x).numpy()[2] == 100_002 and next(traced) == 1
"""


@pytest.mark.parametrize("kind", ["array", "scene"])
def test_garbage_does_not_end_the_process_that_records_a_function(kind):
    command = [sys.executable, "-c", WITH_GARBAGE, kind]
    done = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("enabled", [True, False])
@pytest.mark.parametrize("good", [True, False])
def test_whether_garbage_is_collected_is_after_a_call_as_it_was_before(enabled, good):
    @frozen
    def increased(x):
        assert good and not gc.isenabled()
        return x + 1

    (gc.enable if enabled else gc.disable)()
    try:
        with nullcontext() if good else pytest.raises(AssertionError):
            assert increased(dr.arange(mi.Float, 3)).numpy().tolist() == [1, 2, 3]
        assert gc.isenabled() == enabled
    finally:
        gc.enable()


def test_no_recording_is_taken_for_another_whatever_the_constants():
    @frozen
    def increased(x, bits, number):
        return x + sum(1 << k for k, bit in enumerate(bits) if bit) + 100 * number

    for bits in itertools.product((True, False), repeat=6):
        for number in (1, 2, 3):
            expected = sum(1 << k for k, bit in enumerate(bits) if bit) + 100 * number
            assert increased(dr.arange(mi.Float, 3), bits, number).numpy()[0] == expected


def kind_of(value) -> str:
    return described(value)[0]


NUMBERS = [-1, -2, 0, 1, True, False, 1.0, 0.0, -0.0, 1 << 61, (1 << 61) + 1, float("nan"), None, "1", "True"]


def test_numbers_that_are_equal_or_have_one_hash_are_told_apart_and_the_same_is_not():
    kinds = [kind_of((mi.Float(0), [number])) for number in NUMBERS]
    assert len(set(kinds)) == len(NUMBERS)
    assert kinds == [kind_of((mi.Float(1), [number])) for number in NUMBERS]


def test_structures_with_the_same_numbers_are_told_apart():
    @dataclass(frozen=True)
    class A:
        x: object
        y: object = 2

    @dataclass
    class B:
        x: object
        y: object = 2

    values = [(1, 2), [1, 2], [[1], 2], [[1, 2]], [(1, 2)], A(1), B(1), A(True), A(A(1)), {"x": 1, "y": 2},
              {"x": 1, "z": 2}, "1 2", np.float32(1), np.int64(1), 1]
    assert len({kind_of(value) for value in values}) == len(values)
    assert kind_of(A(1)) == kind_of(A(1, 2))


def test_an_argument_of_which_nothing_is_known_is_refused():
    with pytest.raises(TypeError, match="takes arrays, numbers, strings and what is made of them, not <object"):
        described((mi.Float(0), object()))


def test_no_recording_is_taken_for_another_whichever_arguments_are_the_same_array():
    """``(a, b, a)`` and ``(a, b, b)`` are one to Dr.Jit 1.5."""

    @frozen
    def weighted(arrays):
        a, b, c = arrays
        return a + 10 * b + 100 * c

    for order in itertools.product(range(3), repeat=3):
        digits = [dr.opaque(mi.Float, d) for d in range(3)]
        assert weighted([digits[d] for d in order]).numpy()[0] == sum(10**k * d for k, d in enumerate(order))


def test_what_is_traced_has_the_structure_of_the_arguments():
    """Dr.Jit is given their arrays alone."""

    class Pair(NamedTuple):
        a: mi.Float
        b: str

    @dataclass(frozen=True)
    class Holder:
        inside: dict
        number: float = 2.5

    @frozen
    def increased(holder, *others, last):
        assert isinstance(holder, Holder) and holder.number == 2.5 and holder.inside["pair"].b == "b"
        assert isinstance(holder.inside["pair"], Pair) and others == (None, [1, (True,)])
        assert last[0] is holder.inside["pair"].a and last[1] is not last[0]
        return last[0] + 10 * last[1]

    for k in range(3):
        a, b = dr.opaque(mi.Float, k), dr.opaque(mi.Float, k + 1)
        assert increased(Holder({"pair": Pair(a, "b")}), None, [1, (True,)], last=[a, b]).numpy()[0] == 11 * k + 10


def test_a_recording_keeps_no_array_of_its_first_call():
    @frozen
    def increased(holder):
        return holder["x"] + 1

    def alive() -> bool:
        return "12347" in (dr.whos(as_string=True) or "")

    x = dr.opaque(mi.Float, 0, 12347)
    increased({"x": x})
    assert alive()
    del x
    assert not alive()


def test_a_frozen_function_is_traced_once_for_all_sizes():
    traced = itertools.count()

    @frozen
    def doubled(x):
        next(traced)
        return x * 2

    assert [doubled(dr.arange(mi.Float, n)).numpy()[-1] for n in (3, 30, 300)] == [4, 58, 598]
    assert next(traced) == 1


def test_a_function_for_sizes_is_traced_once_for_each_and_again_when_others_were_asked_for_since():
    traced = []

    @frozen_for_sizes
    def with_zeros(x):
        traced.append(dr.width(x))
        zeros = dr.zeros(mi.Float, 2 * dr.width(x))  # of the size that is recorded
        dr.scatter_add(zeros, x, dr.arange(mi.UInt32, dr.width(x)))
        return zeros

    def sizes(*numbers: int) -> list[int]:
        traced.clear()
        for n in numbers:
            result = with_zeros(dr.arange(mi.Float, n) + dr.opaque(mi.Float, 1))
            np.testing.assert_array_equal(result.numpy(), [*range(1, n + 1), *([0] * n)])
        return sorted(set(traced))

    assert sizes(2, 3, 2, 3) == [2, 3]
    assert sizes(2, 3, 3, 2) == []
    assert sizes(*range(4, 4 + KINDS_KEPT)) == list(range(4, 4 + KINDS_KEPT))
    assert sizes(2) == [2]


def test_what_a_function_raises_while_it_is_recorded_is_raised():
    @frozen
    def refused(x):
        raise ValueError("not this one")

    with pytest.raises(ValueError, match="not this one"):
        refused(dr.arange(mi.Float, 3))
