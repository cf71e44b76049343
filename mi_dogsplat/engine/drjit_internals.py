"""What is used of Dr.Jit that it does not document (``dr.detail``): all of it is here.

``tests/engine/test_drjit_internals.py`` names the version with which it was checked, and what to look at in another.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from itertools import pairwise
from typing import Any

import drjit as dr

from .arrays import array_types

DIGIT = 14  # bits that one counting pass sorts by


def argsort_small(key: Any, count: int) -> Any:
    """Stable argsort of integers below ``count`` on LLVM: one counting pass where ``dr.argsort`` needs three.

    On CUDA a pass with so many buckets keeps no order of equal keys.
    """
    types, order = array_types(), None
    bits, digits = digits_of(count, DIGIT)
    for first, last in digits:
        buckets = min(count, 1 << (last - first))
        digit = key if order is None else dr.gather(types.UInt, key, order)
        if last - first < bits:
            digit = (digit >> first) & (buckets - 1)
        dr.eval(digit)
        permuted = dr.detail.block_mkperm(digit, dr.width(key), buckets)
        order = permuted if order is None else dr.gather(types.UInt, order, permuted)
    return order


def digits_of(count: int, largest: int) -> tuple[int, list[tuple[int, int]]]:
    """(Bits of integers below ``count``, as few digits of at most ``largest`` bits as they have, from the lowest: first
    bit and the one behind the last)."""
    bits = max(1, (count - 1).bit_length())
    passes = -(-bits // largest)
    return bits, list(pairwise(bits * k // passes for k in range(passes + 1)))


def variable_indices(values: list) -> list[int]:
    """Those of all JIT and AD variables in nested values: equal as long as none is another variable.

    A variable that is gone may give its index to the next one. So whoever compares with indices from before keeps the
    values of that time, as ``held``.
    """
    return dr.detail.collect_indices(values)


def held(values: Iterable) -> list:
    """The same JIT variables in arrays of their own, without derivatives.

    The parameters of Mitsuba's objects, and the array of a tensor, are views: assigned to in place, they hold the new
    variable and let the old one go.
    """
    return [type(value)(dr.detach(value)) for value in values]


@lru_cache
def llvm_packet() -> int:
    """Lanes that run together on LLVM: 16 with AVX-512, 8 with AVX2, 4 with NEON and SSE.

    Dr.Jit has no function that says it, but the code of any kernel does. Call it outside of frozen functions, which
    hide their kernels.
    """
    value = dr.opaque(dr.llvm.Float, 0, 2) + 1
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.eval(value)
        history: Any = dr.kernel_history([dr.KernelType.JIT])
    return max(int(size) for kernel in history for size in re.findall(r"<(\d+) x float>", kernel["ir"].getvalue()))
