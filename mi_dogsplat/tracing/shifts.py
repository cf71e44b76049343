"""Primitives whose place depends on the view: where a ray sees them, which is by its own direction (docs/shifts.md).

Along the unit direction d of the ray such a primitive stands at m + G d, where

    m = μ - R S A v̄,    G = R S A Rᵀ    (``scene/shifts.py``)

So m is the mean of its places over all directions. It is what ``Primitives`` and the tree have for μ; and however a ray
runs, along axis k of the world the centre is no farther from it than row k of G is long.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr

from .row_tables import Row, RowTable
from .tree import NONE, Tree
from .vectors import dot


@dataclass
class Shift:
    """Whether a primitive has one, and along which ray it is seen."""

    row: Row
    direction: list  # d


def read_shift(tree: Tree, splat: Any, d: list, inverse_square: Any, active: Any) -> Shift | None:
    """Of a primitive on a ray with the direction ``d``; None in a model without.

    inverse_square: 1 / |d|².
    """
    if tree.shifts is None:
        return None
    row = tree.shifts.row_of(splat, active & (splat != NONE))
    inverse = dr.sqrt(inverse_square)
    return Shift(row, [x * inverse for x in d])


def moved_by(table: RowTable, shift: Shift, active: Any) -> list:
    """G d, or its tangent if the ``table`` is that of tangents; 0 of a primitive that stays where it is."""
    G = table.read(shift.row, active)
    return [dot(G[3 * k : 3 * k + 3], shift.direction) for k in range(3)]


def add_adjoints(table: RowTable, shift: Shift, δmean: list, active: Any) -> None:
    """To those of G, where the centre on the ray has the adjoint ``δmean``."""
    table.add(shift.row, [δ * x for δ in δmean for x in shift.direction], active)
