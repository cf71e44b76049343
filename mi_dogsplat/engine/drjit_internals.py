"""What is used of Dr.Jit that it does not document (``dr.detail``): all of it is here.

``tests/engine/test_drjit_internals.py`` names the version with which it was checked, and what to look at in another.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

import drjit as dr

MAX_BUCKETS = 1 << 14  # of one counting pass


def argsort_small(key: Any, count: int) -> Any:
    """Stable argsort of integers below ``count``: one counting pass where ``dr.argsort`` needs three."""
    if count > MAX_BUCKETS:
        return dr.argsort(key)
    dr.eval(key)
    return dr.detail.block_mkperm(key, dr.width(key), count)


def variable_indices(values: list) -> list[int]:
    """Those of all JIT and AD variables in nested values: equal as long as none is another variable."""
    return dr.detail.collect_indices(values)


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
