"""Which primitives of a model have numbers that are finite."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .row_groups import GROUPS, Array, RowGroup
from .splats import DENSE, Splats


def finite_rows(*arrays: Array) -> Array:
    """[N] bool, whether all numbers of a row are finite, in each of the arrays [N, …]."""
    return np.logical_and.reduce([np.isfinite(values).all(axis=tuple(range(1, values.ndim))) for values in arrays])


def finite_in(splats: Splats, groups: Iterable[RowGroup]) -> Array:
    """[N] bool, whether all numbers are finite that a primitive has in these groups; so are those of one in none."""
    finite = np.ones(splats.n_splats, bool)
    for group in groups:
        finite[getattr(splats, group.index)] &= finite_rows(*(getattr(splats, name) for name in group.names))
    return finite


def finite_primitives(splats: Splats) -> Array:
    """[N] bool, whether all numbers are finite that a primitive has."""
    return finite_rows(*(getattr(splats, name) for name in DENSE)) & finite_in(splats, GROUPS)
