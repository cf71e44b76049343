"""Primitives as the rows that rays read, detached: a cache line each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..engine.arrays import array_types, detached
from ..engine.project import NOT_DOG
from .primitives import Primitives

ROW = 16  # floats: M, mean, lo, and as bits the DoG row and the primitive; one is free
PSEUDO_ROW = 8  # floats: F⁻¹, weights of the nearest point, lo of the pseudo-Gaussian; one is free


@dataclass
class Tables:
    """What a ray reads of primitives, in any order: that of the tree that has them as leaves."""

    rows: Any  # Float [N', ROW]
    pseudo: Any  # Float [M, PSEUDO_ROW] or None
    sh: Any  # Float [N, K, 3]
    sh_stride: int  # 3 K


def pack(primitives: Primitives, order: Any, log2_range: float) -> Tables:
    """Rows of the primitives ``order`` [N'].

    log2_range: -log2 of the smallest kernel value that is looked at.
    """
    types = array_types()
    n, n_rows = dr.width(primitives.lo), dr.width(order)
    dog_row = dr.full(types.UInt, NOT_DOG, n) if primitives.dog_row is None else detached(primitives.dog_row)
    columns = [detached(c) for c in (*primitives.to_kernel, *primitives.mean, primitives.lo)]
    dr.eval(columns, dog_row)
    values = [dr.gather(types.Float, c, order) for c in columns]
    values += [dr.reinterpret_array(types.Float, bits) for bits in (dr.gather(types.UInt, dog_row, order), order)]
    rows = _table(values, n_rows, ROW)
    pseudo = None
    if primitives.pseudo_lo is not None:
        m = dr.width(primitives.pseudo_lo)
        inverse = [detached(f) for f in primitives.inverse_factors]
        lo, of_primary = detached(primitives.pseudo_lo), detached(primitives.lo)
        primary = dr.gather(types.Float, of_primary, inverse_rows(dog_row, m))
        weights = nearest_weights(inverse, primary + log2_range, lo + log2_range)
        pseudo = _table([*inverse, *weights, lo], m, PSEUDO_ROW)
    sh = detached(primitives.sh)
    dr.eval(rows, pseudo, sh)
    return Tables(rows, pseudo, sh, dr.width(sh) // n)


def inverse_rows(dog_row: Any, m: int) -> Any:
    """[M] the primitive of each row."""
    types = array_types()
    index = dr.zeros(types.UInt, m)
    dr.scatter(index, dr.arange(types.UInt, dr.width(dog_row)), dog_row, dog_row != NOT_DOG)
    return index


def nearest_weights(inverse_factors: list, primary_range: Any, pseudo_range: Any) -> list:
    """Squared axes of the primary's cutoff ellipsoid over those of the one that holds both, axis by axis, at most 1.

    Ranges are squared radii of the kernels above the cutoff, in their own units.
    """
    ratio = dr.select(pseudo_range > 0, primary_range / dr.maximum(pseudo_range, 1e-6), dr.inf)
    return [dr.minimum(1, ratio * f * f) for f in inverse_factors]


def _table(columns: list, n: int, stride: int) -> Any:
    """Columns as a row-major table with rows of ``stride`` floats."""
    types = array_types()
    table, index = dr.zeros(types.Float, n * stride), dr.arange(types.UInt, n)
    for k, column in enumerate(columns):
        dr.scatter(table, column, dr.fma(index, stride, k), mode=dr.ReduceMode.Permute)
    return table
