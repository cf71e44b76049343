"""Rows of floats that some primitives have: their values, or the adjoints or tangents of these."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr

from ..engine.arrays import array_types, detached
from ..engine.rows import NO_ROW, read_row


@dataclass
class Row:
    """Of a primitive in a ``RowTable``."""

    at: Any  # UInt
    here: Any  # Bool, whether there is one


@dataclass
class RowTable:
    """[R, stride] floats, row-major. What those of a row mean is said where they are read: ``varying.py``,
    ``shifts.py``."""

    values: Any  # Float
    used: int  # floats of a row; free ones follow, up to a multiple of four, as four are read and added to at once
    row_from_splat: Any  # UInt [N] row of a primitive or NO_ROW; None where leaves of the tree have it

    @staticmethod
    def of(columns: list, row_from_splat: Any = None) -> RowTable | None:
        """Columns [R], detached; None of none."""
        if not columns:
            return None
        values = table(detached(columns), _stride(len(columns)))
        return RowTable(values, len(columns), None if row_from_splat is None else detached(row_from_splat))

    def row_of(self, splat: Any, active: Any) -> Row:
        """Of primitives that are ``active``."""
        row = dr.gather(array_types().UInt, self.row_from_splat, splat, active)
        return Row(row, (row != NO_ROW) & active)

    def read(self, row: Row, active: Any) -> list:
        """Its floats; 0 where there is no row."""
        return read_row(self.values, row.at, _stride(self.used), self.used, row.here & active)

    def add(self, row: Row, values: list, active: Any) -> None:
        """To its floats, of many lanes at once."""
        types, stride, here = array_types(), _stride(self.used), active & row.here
        values = values + [types.Float(0)] * (stride - len(values))
        for k in range(stride // 4):
            part, at = types.Quad(*values[4 * k : 4 * k + 4]), dr.fma(row.at, stride // 4, k)
            dr.scatter_add(self.values, part, at, here, mode=dr.ReduceMode.Local)

    def zeros(self) -> RowTable:
        """A table for the adjoints of this one."""
        return replace(self, values=dr.zeros(array_types().Float, dr.width(self.values)))

    def tangents(self, columns: list) -> RowTable:
        """A table of the tangents ``columns`` of this one."""
        n, stride = dr.width(self.values) // _stride(self.used), _stride(self.used)
        return replace(self, values=table([wide(c, n) for c in columns], stride))

    def columns(self) -> list:
        """[R] each."""
        return columns_of(self.values, _stride(self.used), self.used)


def _stride(used: int) -> int:
    return -(-used // 4) * 4


def table(columns: list, stride: int) -> Any:
    """Columns [n] as a row-major table with rows of ``stride`` floats, zeros beyond them."""
    types, n = array_types(), dr.width(columns[0])
    rows, row = dr.zeros(types.Float, n * stride), dr.arange(types.UInt, n)
    for k, column in enumerate(columns):
        dr.scatter(rows, column, dr.fma(row, stride, k), mode=dr.ReduceMode.Permute)
    return rows


def columns_of(rows: Any, stride: int, count: int, index: Any = None) -> list:
    """The first ``count`` columns of such a table; ``index``: of these rows alone."""
    types = array_types()
    row = dr.arange(types.UInt, dr.width(rows) // stride) if index is None else index
    return [dr.gather(types.Float, rows, dr.fma(row, stride, k)) for k in range(count)]


def wide(column: Any, n: int) -> Any:
    """A tangent, which may be a single 0, as an array of its own."""
    return detached(column) + dr.zeros(array_types().Float, n)
