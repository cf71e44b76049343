"""A view ready to be walked, in one piece or in bands of tile rows: what every walk takes.

Most memory of an isect, for its sums in a walk and for the making of its lists, is needed for one band at a time. The
lists themselves are kept for the next walk. Primitives are projected, packed and sorted by depth once.

The result has the same bits. Bands are walked from top to bottom, and a primitive adds up its isects in this order
whether there are bands or not. The lists of a band begin at the bit of a word at which they would begin in those of the
whole view: so the lanes of a tile are at the same isects at the same time, and add to their sums in the same order.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TypeAlias, TypeVar

import drjit as dr
import numpy as np

from .arrays import array_types
from .geometry import Grid, Lanes
from .isects import Isects, count_isects
from .options import Settings
from .project import Projection
from .tables import Tables
from .tiles import WORD, TileLists, list_isects, tiles

Result = TypeVar("Result")
LISTED, WALKED = 25, 115  # bytes of an isect: of the lists that are kept, and of what a walk with derivatives takes
MOST_ISECTS = 2**27 - WORD  # isects of a band: a walk has up to 32 sums of each, and Dr.Jit no arrays of 2^32 numbers


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

    def walked(self, walk: Callable[[PreparedView, Result], Result], nothing: Result) -> Result:
        """What ``walk`` returns, given ``nothing`` for the bands above."""
        return walk(self, nothing)


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
    lists: list[TileLists] = field(default_factory=list)  # of the bands that have been walked so far

    @property
    def n_splats(self) -> int:
        return dr.width(self.isects.counts)

    @property
    def n_isects(self) -> int:
        return self.isects.total

    def walked(self, walk: Callable[[PreparedView, Result], Result], nothing: Result) -> Result:
        """What ``walk`` returns for the last band, given what it returned for the bands above, at first ``nothing``."""
        result = nothing
        for k, band in enumerate(self.bands):
            lanes = self.grid.lanes_of(band.rows)
            if k == len(self.lists):
                isects = self.isects.in_rows(band.rows, band.isects_above % WORD)
                self.lists.append(list_isects(isects, self.grid.blocks, lanes))
            result = walk(PreparedView(self.grid, lanes, self.tables, self.lists[k], self.settings), result)
            dr.sync_thread()  # what the band needed is given back when it is finished, and not before
        return result


WalkableView: TypeAlias = PreparedView | BandedView


def listed(
    projection: Projection, tables: Tables, grid: Grid, settings: Settings, isect_memory: float | None = None
) -> WalkableView:
    """A view in one piece, or in bands where its isects need more than ``isect_memory`` bytes or are more than
    ``MOST_ISECTS``.

    On CUDA always in one piece: an isect needs some 30 bytes there, as sums are not its own but its primitive's.
    """
    isects = count_isects(projection, grid, settings.cutoffs) if array_types().is_llvm else None
    memory = math.inf if isect_memory is None else isect_memory
    if isects and (isects.total > MOST_ISECTS or (LISTED + WALKED) * isects.total > memory):
        most = int(max(0, min(MOST_ISECTS, (memory - LISTED * isects.total) / WALKED)))
        return BandedView(grid, tables, isects, settings, bands_of(isects.per_row(grid.tiles_y), most))
    return PreparedView(grid, grid.lanes, tables, tiles(projection, grid, settings.cutoffs, isects), settings)


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
