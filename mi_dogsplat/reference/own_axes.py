"""Models of which some primitives have numbers along their own axes, for the twins: slopes of a colour, and cuts.

The primitives `slope_index` [S] have `color_slopes` [S, 3, 3], the change of colour per standard deviation along each
axis (axis, channel). The primitives `curvature_index` [B] have `brightness_curvatures` [B, 6], xx yy zz xy xz yz of Q:
all channels are brighter by w^T Q w / 2. The primitives `cut_index` [C] have `cut_normals` [C, 3], n, by which a plane
multiplies kernels w standard deviations away from the centre, and the primitives `second_cut_index` a second plane:

    g(w) = (1 + e^-4) / (1 + e^(-4 - n.w))

In a picture n.w is h.d at the offset d, and h is 16 long at most.

A model that has no such arrays is of even colours, or whole.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..scene.cuts import OFFSET, STEEPEST
from ..scene.row_groups import BESIDE_DOG, RowGroup

if TYPE_CHECKING:
    from ..scene.splats import Splats

LARGEST_KEPT = 1 + np.exp(-OFFSET)  # g far out on the side that is kept


def index_of(splats: Splats, group: RowGroup) -> np.ndarray:
    """The primitives that are in the group."""
    return np.asarray(getattr(splats, group.index, ()), np.int64)


def values_of(splats: Splats, group: RowGroup) -> np.ndarray:
    """What they have along their axes, float64: [S, 3, 3] slopes, [B, 6] curvatures or [C, 3] normals."""
    (values,) = arrays_of(splats, group)
    return values


def arrays_of(splats: Splats, group: RowGroup) -> tuple[np.ndarray, ...]:
    """The arrays of a group, float64."""
    if not len(index_of(splats, group)):
        return tuple(np.zeros((0, *row)) for row in group.arrays.values())
    return tuple(np.asarray(getattr(splats, name), np.float64) for name in group.arrays)


def quadratic_forms(rows: np.ndarray) -> np.ndarray:
    """Q [B, 3, 3] of rows [B, 6]."""
    xx, yy, zz, xy, xz, yz = rows.T
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)


def names_of_rows(splats: Splats) -> tuple[str, ...]:
    """Names of the arrays that there are: of slopes, curvatures, cuts and shifts."""
    return tuple(name for group in BESIDE_DOG for name in group.names if len(index_of(splats, group)))


def kept(along_normal: np.ndarray) -> np.ndarray:
    """g of n.w; neither far out nor far beyond the plane does it overflow."""
    return LARGEST_KEPT * np.exp(-np.logaddexp(0, -OFFSET - along_normal))


def no_steeper(h: np.ndarray) -> np.ndarray:
    """Changes of n.w per pixel, [n, 2], shortened to what a picture shows."""
    return h * (STEEPEST / np.maximum(lengths(h), STEEPEST))[:, None]


def lengths(h: np.ndarray) -> np.ndarray:
    """[n] of vectors [n, 2], however long."""
    return np.hypot(*h.T)


def largest_kept(cut: np.ndarray) -> np.ndarray:
    """[N] by what a kernel may be multiplied at most, of primitives that each plane does `cut` or not, [2, N]."""
    return LARGEST_KEPT ** np.sum(cut, axis=0)


def log_kept_slope(along_normal: np.ndarray) -> np.ndarray:
    """The derivative of log g by n.w, from 0 far out to 1 far beyond the plane."""
    return np.exp(-np.logaddexp(0, OFFSET + along_normal))
