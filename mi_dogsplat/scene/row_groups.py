"""Groups of rows that only some primitives have: an index [M], and arrays with a row for each entry of it.

Row ``j`` of a group's arrays belongs to primitive ``index[j]``; every other primitive pays nothing for the group. A
group of its own is what makes a primitive DoG, what lets its colour vary from end to end, and its brightness from the
middle outwards, what cuts it off along a plane, and along a second one, what lets its place depend on the view, and
what each degree of view-dependent colour takes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..support.wording import counted

MAX_SH_DEGREE = 3
Array = NDArray[Any]


@dataclass(frozen=True)
class RowGroup:
    """Names of a group's arrays, which are those of a model, of its parameters on the device and in an optimizer."""

    index: str
    """[M] strictly increasing"""
    arrays: Mapping[str, tuple[int, ...]] = field(hash=False)
    """name to the shape of a row"""

    @property
    def row(self) -> str:
        """Name of the inverse of the index, [N]: the row of each primitive."""
        return self.index.replace("_index", "_row")

    @property
    def row_size(self) -> int:
        """Numbers of a row, of all arrays."""
        return sum(math.prod(shape) for shape in self.arrays.values())

    @property
    def names(self) -> tuple[str, ...]:
        """Of the arrays with values."""
        return tuple(self.arrays)


DOG = RowGroup("dog_index", {"dog_logit_opacities": (), "dog_log_scales": (3,)})
SLOPES = RowGroup("slope_index", {"color_slopes": (3, 3)})
CURVATURES = RowGroup("curvature_index", {"brightness_curvatures": (6,)})
CUTS = RowGroup("cut_index", {"cut_normals": (3,)})
SECOND_CUTS = RowGroup("second_cut_index", {"second_cut_normals": (3,)})
PLANES = (CUTS, SECOND_CUTS)
"""Each may cut a primitive off, with or without the other."""
SHIFTS = RowGroup("shift_index", {"view_shifts": (3, 3), "mean_views": (3,)})
SH = {
    degree: RowGroup(f"sh{degree}_index", {f"sh{degree}_coeffs": ((degree + 1) ** 2 - 1, 3)})
    for degree in range(1, MAX_SH_DEGREE + 1)
}
OWN_AXES = (SLOPES, CURVATURES, *PLANES)
"""What is told along the primitives' own axes."""
BESIDE_DOG = (*OWN_AXES, SHIFTS)
"""What primitives may have besides, be they DoG or not, but for view-dependent colour."""
NAMED: dict[str, RowGroup] = dict(
    zip(("slopes", "curvatures", "cuts", "second_cuts", "shifts"), BESIDE_DOG, strict=True)
)
"""These by what files and settings call their rows."""
BESIDE_COLORS = (DOG, *BESIDE_DOG)
"""All but those of view-dependent colour."""
GROUPS = (*BESIDE_COLORS, *SH.values())
ALONG_AXES = {name: group for group in (SLOPES, *PLANES) for name in group.names}
"""Arrays whose rows are per standard deviation along the axes of their primitive; the axis comes first."""
REVERSED = (*ALONG_AXES, "mean_views")
"""Arrays that change their sign where the axes of their primitive are turned round."""


def checked_index(name: str, index: ArrayLike, n_splats: int) -> Array:
    """``index`` as uint32 [M]; raises ``ValueError`` unless it increases strictly within 0..n_splats-1."""
    index = np.asarray(index)
    if index.ndim != 1 or (index.size and index.dtype.kind not in "iu"):
        raise ValueError(f'Splats: "{name}" is {index.dtype} {list(index.shape)}, expected integers [M]')
    if index.size:
        low, high = int(index.min()), int(index.max())
        if low < 0 or high >= n_splats:
            raise ValueError(f'Splats: "{name}" spans {low} to {high}, "means" has {counted(n_splats, "row")}')
        if np.any(index[1:] <= index[:-1]):
            raise ValueError(f'Splats: "{name}" is not strictly increasing; sort it, each primitive once')
    return np.ascontiguousarray(index, dtype=np.uint32)


def in_several(indices: Iterable[Array]) -> int | None:
    """A primitive that more than one index names, the first one; None if there is none."""
    named, times = np.unique(np.concatenate(list(indices)), return_counts=True)
    several = named[times > 1]
    return int(several[0]) if several.size else None


def row_of_splats(index: Array, n_splats: int) -> Array:
    """[N] row of each primitive in a group, or -1."""
    rows = np.full(n_splats, -1)
    rows[index] = np.arange(len(index))
    return rows


def selected(index: Array, n_splats: int, old_from_new: Array) -> tuple[Array, Array]:
    """A group after a selection of primitives [N'], repeats allowed: (its index [M'], the old row of each row [M'])."""
    rows = row_of_splats(index, n_splats)[old_from_new]  # [N'] or -1
    new_index = np.flatnonzero(rows >= 0)  # increasing by construction
    return new_index, rows[new_index]
