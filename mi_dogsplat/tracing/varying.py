"""How the colour of a primitive varies over it, at the point w where a ray sees it: by slopes, by curvatures, or both.

Beyond the colour of the centre it has Σ_a w_a slope_a there, and ½ wᵀ Q w in each channel. Both are linear in what a
primitive has in a table, so that a table of tangents is read in the same way. By w the derivative is slope_a + (Q w)_a.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from ..scene.curvatures import ENTRIES, OF_MATRIX
from .row_tables import Row, RowTable
from .vectors import dot


@dataclass
class Varying:
    """Whether the colour of a primitive varies over it."""

    slopes: Row | None  # None in a model without
    curvatures: Row | None  # None in a model without

    @property
    def here(self) -> Any:
        """Bool, by one or the other."""
        first, *rest = (row.here for row in (self.slopes, self.curvatures) if row)
        return first | rest[0] if rest else first


class VaryingTables(Protocol):
    """Values, or their adjoints or tangents: a tree's own, ``Adjoints`` or ``Tangents``."""

    slopes: RowTable | None
    curvatures: RowTable | None


def beyond_centre(tables: VaryingTables, varying: Varying, w: list, active: Any) -> list:
    """What the colour has at ``w`` beyond that of its centre; three channels, not limited."""
    found = []
    if varying.slopes and tables.slopes:
        found.append(along(w, _slopes(tables.slopes, varying.slopes, active)))
    if varying.curvatures and tables.curvatures:
        found.append([0.5 * dot(w, _curved(tables.curvatures, varying.curvatures, w, active))] * 3)
    return _sum(found)


def by_point(tables: VaryingTables, varying: Varying, w: list, active: Any) -> list:
    """The derivative of that by w: three axes of three channels."""
    found = []
    if varying.slopes and tables.slopes:
        found += _slopes(tables.slopes, varying.slopes, active)
    if varying.curvatures and tables.curvatures:
        curved = [[steep] * 3 for steep in _curved(tables.curvatures, varying.curvatures, w, active)]
        found = [_sum([a, b]) for a, b in zip(found, curved, strict=True)] if found else curved
    return found


def along(w: list, steepness: list) -> list:
    """Three channels of w · steepness, which has three axes of them."""
    return [dot(w, [axis[channel] for axis in steepness]) for channel in range(3)]


def add_adjoints(tables: VaryingTables, varying: Varying, w: list, δcolors: list, active: Any) -> None:
    """What three channels of ``beyond_centre`` add to those of the values, where these have adjoints ``δcolors``."""
    if varying.slopes and tables.slopes:
        tables.slopes.add(varying.slopes, [x * δ for x in w for δ in δcolors], active)
    if varying.curvatures and tables.curvatures:
        δ = sum(δcolors)
        squares = [w[a] * w[b] * (0.5 * δ if a == b else δ) for a, b in ENTRIES]
        tables.curvatures.add(varying.curvatures, squares, active)


def _slopes(table: RowTable, row: Row, active: Any) -> list:
    """Three axes of three channels; 0 where there are none."""
    values = table.read(row, active)
    return [values[0:3], values[3:6], values[6:9]]


def _curved(table: RowTable, row: Row, w: list, active: Any) -> list:
    """Q w; 0 where there is no Q."""
    entries = table.read(row, active)
    return [dot(w, [entries[k] for k in of_axis]) for of_axis in OF_MATRIX]


def _sum(vectors: list) -> list:
    """Of one or two."""
    return [a + b for a, b in zip(*vectors, strict=True)] if len(vectors) > 1 else vectors[0]
