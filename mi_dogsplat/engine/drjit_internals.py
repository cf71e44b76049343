"""What is used of Dr.Jit that it does not document (``dr.detail``): all of it is here.

``tests/engine/test_drjit_internals.py`` names the version with which it was checked, and what to look at in another.
"""

from __future__ import annotations

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
