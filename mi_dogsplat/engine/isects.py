"""How many isects there are to list, before any is: of the whole image, or of a band of its tile rows.

An *isect* is a tile and a primitive that touches it. Their number decides whether they are listed at once or band by
band (``bands.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from .arrays import array_types, detached, while_loop
from .footprints import Footprints
from .geometry import Cutoffs, Grid
from .project import Projection

FEW_DOG = 500  # primitives for each that is DoG, from which on most tiles have none


@dataclass
class Isects:
    """Counted, and in depth order."""

    footprints: Footprints
    counts: Any  # UInt [N]
    splat_from_rank: Any  # UInt [N], nearest first; primitives that touch no tile of the image are anywhere
    ends: Any  # UInt [N], running sum of the counts, by rank; it begins with what is ``blank``
    total: int  # with ``blank``
    blank: int = 0  # the first of them, which are nobody's
    dog_row: Any = None  # UInt [N], that of the projection, where few primitives are DoG

    @staticmethod
    def counted(footprints: Footprints, counts: Any, splat_from_rank: Any, dog_row: Any, blank: int = 0) -> Isects:
        """Waits for the device, to learn the total."""
        ends = dr.cumsum(dr.gather(array_types().UInt, counts, splat_from_rank))
        if blank:
            ends += dr.opaque(array_types().UInt, blank)
        total = int(ends[dr.width(ends) - 1])
        return Isects(footprints, counts, splat_from_rank, ends, total, blank, dog_row)

    def in_rows(self, rows: range, blank: int) -> Isects:
        """Those of the tile rows ``rows``, after some that are blank. Waits for the device."""
        footprints = self.footprints.in_rows(rows)
        counts = _counts(footprints)
        dr.eval(counts)
        return Isects.counted(footprints, counts, self.splat_from_rank, self.dog_row, blank)

    def per_row(self, n_rows: int) -> np.ndarray:
        """[n_rows] in each tile row of the image. Waits for the device."""
        UInt, footprints = array_types().UInt, self.footprints
        table = dr.zeros(UInt, n_rows)

        def add(row):
            first, last = footprints.columns(row)
            dr.scatter_add(table, UInt(last - first), UInt(row))
            return (row + 1,)

        while_loop((footprints.first,), lambda row: row < footprints.last, add, "isects per row", ("row",))
        return table.numpy()


def count_isects(projection: Projection, grid: Grid, cutoffs: Cutoffs) -> Isects:
    """Of the whole image. Waits for the device once."""
    footprints = Footprints(projection, grid, cutoffs.log2_range)
    counts = _counts(footprints)
    depths = depth_bits(projection)
    dr.eval(depths, counts, footprints.kept())  # or the projection would be computed again where isects are emitted
    return Isects.counted(footprints, counts, dr.argsort(depths), _few_dog(projection))


def _few_dog(projection: Projection) -> Any:
    """``Isects.dog_row``. The share of DoG in the model decides: deciding by the lists of a view, kernels would change
    from view to view."""
    if projection.pseudo is None or dr.width(projection.dog_index) * FEW_DOG > dr.width(projection.x):
        return None
    return detached(projection.dog_row)


def depth_bits(projection: Projection) -> Any:
    """UInt [N]: positive floats sort like their bits."""
    return dr.reinterpret_array(array_types().UInt, detached(projection.depth))


def _counts(footprints: Footprints) -> Any:
    UInt = array_types().UInt

    def count_row(row, count):
        first, last = footprints.columns(row)
        return row + 1, count + UInt(last - first)

    start = footprints.first, UInt(0)
    return while_loop(start, lambda row, count: row < footprints.last, count_row, "count")[1]
