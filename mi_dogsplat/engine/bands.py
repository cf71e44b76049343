"""A view ready to be walked, in one piece or in bands of tile rows: what every walk takes.

Most of what an isect needs, its sums of a walk and what its lists are made of, is needed of one band at a time. The
lists themselves are kept for the next walk. Primitives are projected, packed and sorted by depth once.

The result has the same bits. Bands are walked from top to bottom, and a primitive adds up its isects in this order
whether there are bands or not. The lists of a band begin at the bit of a word at which they would begin in those of the
whole view: so the lanes of a tile are at the same isects at the same time, and add to their sums in the same order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TypeAlias, TypeVar

import drjit as dr
import numpy as np

from .geometry import Grid, Lanes
from .isects import Isects
from .options import Settings
from .tables import Tables
from .tiles import WORD, TileLists, list_isects

Result = TypeVar("Result")
LISTED, WALKED = 20, 180  # bytes of an isect: of the lists that are kept, and of what a walk with derivatives takes


@dataclass
class PreparedView:
    """The argument of the kernels in ``walks/``; without derivatives. All of an image, or one band of it."""

    grid: Grid  # of the whole image
    lanes: Lanes  # of the grid or the band: Dr.Jit does not look for arrays in a grid
    tables: Tables
    lists: TileLists
    settings: Settings

    @property
    def n_splats(self) -> int:
        return dr.width(self.lists.slot_begin)

    @property
    def n_isects(self) -> int:
        return self.lists.n_isects

    def walked(self, walk: Callable[[PreparedView, Result | None], Result]) -> Result:
        """What a walk returns; its second argument is what it has returned for the bands above, here None."""
        return walk(self, None)


@dataclass(frozen=True)
class Band:
    """Some tile rows, and how many isects there are in those above."""

    rows: range
    isects_above: int


@dataclass
class BandedView:
    """A view whose isects need too much memory at once."""

    grid: Grid
    tables: Tables
    isects: Isects
    settings: Settings
    bands: list[Band]  # from top to bottom
    kept: list[PreparedView] = field(default_factory=list)  # the bands, once they have been listed

    @property
    def n_splats(self) -> int:
        return dr.width(self.isects.counts)

    @property
    def n_isects(self) -> int:
        return self.isects.total

    def walked(self, walk: Callable[[PreparedView, Result | None], Result]) -> Result:
        """What a walk returns for the last band; it is given what it has returned for the bands above."""
        result = None
        for k, band in enumerate(self.bands):
            if k == len(self.kept):
                self.kept.append(self._listed(band))
            result = walk(self.kept[k], result)
        assert result is not None
        return result

    def _listed(self, band: Band) -> PreparedView:
        lanes = self.grid.lanes_of(band.rows)
        lists = list_isects(self.isects.in_rows(band.rows, band.isects_above % WORD), self.grid.blocks, lanes)
        return PreparedView(self.grid, lanes, self.tables, lists, self.settings)


WalkableView: TypeAlias = PreparedView | BandedView


def listed(
    tables: Tables, isects: Isects, grid: Grid, settings: Settings, isect_memory: float | None = None
) -> WalkableView:
    """A view in one piece, or, where its isects need more than ``isect_memory`` bytes, in bands."""
    if isect_memory is None or (LISTED + WALKED) * isects.total <= isect_memory:
        return PreparedView(grid, grid.lanes, tables, list_isects(isects, grid.blocks, grid.lanes), settings)
    most = max(0, int((isect_memory - LISTED * isects.total) / WALKED))
    return BandedView(grid, tables, isects, settings, bands_of(isects.per_row(grid.tiles_y), most))


def bands_of(per_row: np.ndarray, most: int) -> list[Band]:
    """Tile rows, cut into bands of at most ``most`` isects, as few as possible; a row that has more is one by itself.

    Args:
        per_row: isects of each tile row.
    """
    above = np.cumsum([0, *per_row]).tolist()
    begins = [0]
    for row in range(1, len(per_row)):
        if above[row + 1] - above[begins[-1]] > most:
            begins.append(row)
    return [Band(range(*rows), above[rows[0]]) for rows in pairwise([*begins, len(per_row)])]
