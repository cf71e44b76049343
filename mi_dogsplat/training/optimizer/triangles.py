"""Lower triangles of a symmetric matrix of each primitive, row by row, as they are kept between steps.

On the CPU each entry is an array: a kernel reads it with one load for all its lanes. On a GPU all entries are one
array, since the host takes longer to hand hundreds of arrays to a replayed function than the GPU takes for its kernel.
"""

from __future__ import annotations

import drjit as dr
import numpy as np

from ...engine.arrays import array_types, detached
from ...engine.parameters import device_array


def n_pairs(d: int) -> int:
    """Entries in the lower triangle of a matrix of d rows, and the place of the first one of row d."""
    return d * (d + 1) // 2


def upload(entries: np.ndarray) -> list:
    """[entries, N] on the device."""
    kept = list(entries) if array_types().is_llvm else [entries]
    return [detached(device_array(values)) for values in kept]


def to_host(kept: list, entries: int) -> np.ndarray:
    """[entries, N], of as many entries."""
    found = np.empty((entries, sum(map(len, kept)) // entries), np.float32)
    for rows, values in zip(np.split(found, len(kept)), kept, strict=True):
        rows[:] = values.numpy().reshape(rows.shape)
    return found


def entries_of(kept: list, n: int) -> list:
    """As [N] arrays, in a kernel of ``n`` lanes."""
    if array_types().is_llvm:
        return kept
    (values,), (lane, stride) = kept, _layout(n)
    return [dr.gather(type(values), values, dr.fma(stride, k, lane)) for k in range(len(values) // n)]


def kept_of(entries: list, n: int) -> list:
    """The other way, in a kernel; [N] each."""
    if array_types().is_llvm:
        return entries
    values, (lane, stride) = dr.empty(array_types().Float, len(entries) * n), _layout(n)
    for k, entry in enumerate(entries):
        dr.scatter(values, entry, dr.fma(stride, k, lane), mode=dr.ReduceMode.Permute)
    return [values]


def _layout(n: int) -> tuple:
    """(Primitive of each lane, entries are how far apart: no literal, with which other sizes would be other kernels)"""
    UInt = array_types().UInt
    return dr.arange(UInt, n), dr.opaque(UInt, n)
