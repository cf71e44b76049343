"""Rows of row-major tables as columns, one lane each: how kernels read what a primitive has."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from .arrays import array_types

NO_ROW = 0xFFFFFFFF  # row of a primitive that is not in a group: is no DoG, has no slopes, or no cut


def rows(array: mi.Float, count: int, index: mi.UInt32, active=True) -> list[mi.Float]:
    """Row ``index`` of a [*, count] array, as ``count`` arrays. Differentiable; a row is read by one lane only."""
    own = array * 1  # the adjoint of Permute overwrites the gradient of its source: of this variable, not the caller's
    return [
        dr.gather(mi.Float, own, dr.fma(index, count, k), active, mode=dr.ReduceMode.Permute)
        for k in range(count)
    ]


def read_rows(array: mi.Float, stride: int, count: int, index: mi.UInt32, active: Any = True) -> list:
    """The first ``count`` columns of row ``index`` of a [*, stride] array. Differentiable; a row is read by one lane
    only.

    Rows of a multiple of four floats are read, and in reverse mode written, four at a time: 3.5 times faster.
    """
    mode = dr.ReduceMode.NoConflicts
    if stride % 4:
        return [dr.gather(mi.Float, array, dr.fma(index, stride, k), active, mode=mode) for k in range(count)]
    values = []
    for k in range(-(-count // 4)):
        values += list(dr.gather(mi.Vector4f, array, dr.fma(index, stride // 4, k), active, mode=mode))
    return values[:count]


def read_row(table: Any, row: Any, stride: int, count: int, active: Any = True) -> list:
    """The first ``count`` floats of a row of a [*, stride] table without derivatives, eight and four at a time.

    Lanes may read the same row, as those of a walk do.
    """
    types, values = array_types(), []
    while len(values) < count:
        size = 8 if count - len(values) > 4 and stride % 8 == 0 else 4 if stride % 4 == 0 else 1
        index = dr.fma(row, stride // size, len(values) // size)
        if size == 8:
            values += list(dr.gather(types.Floats, table, index, active, shape=(8, dr.width(index))))
        else:
            read = dr.gather(types.Quad if size == 4 else types.Float, table, index, active)
            values += list(read) if size == 4 else [read]
    return values[:count]
