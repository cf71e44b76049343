"""Projected primitives as the rows that the compositor reads."""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from .project import Kernels, Projection

FEATURES = 9  # first feature in a primitive's row: x y ux uy vy lo q s t, then the features
PSEUDO_ROW = 8  # floats per pseudo-Gaussian: ux uy vy lo q s t, padding


@dataclass
class Tables:
    """Projected primitives, row-major, one or two cache lines each; what the compositor reads."""

    splats: mi.Float  # [N, row_size]
    pseudo: mi.Float | None  # [M, PSEUDO_ROW]
    dog_row: mi.UInt32 | None  # [N]
    dog_index: mi.UInt32 | None  # [M]
    stop_depth: mi.Float | None = None  # [H*W], deeper primitives (by the feature after the colours) are not blended


def row_size(n_features: int) -> int:
    """Floats per primitive in the table: whole cache lines, in which packets of eight are aligned."""
    return -(-(FEATURES + n_features) // 16) * 16


def _pack(columns: list, stride: int) -> mi.Float:
    n = max(dr.width(c) for c in columns)
    Float = dr.detached_t(mi.Float)
    table = dr.empty(Float, n * stride)
    index = dr.arange(dr.detached_t(mi.UInt32), n)
    for k, column in enumerate(columns):
        value = dr.detach(column, preserve_type=False)
        dr.scatter(table, value, dr.fma(index, stride, k), mode=dr.ReduceMode.Permute)
    return table


def pack(projection: Projection, features: list) -> Tables:
    """Lay out a projection for the compositor (detached: derivatives are passed by hand, see ``rasterize.py``)."""

    def shape(k: Kernels) -> list:
        ratios = k.ux * k.ux, k.ux * k.uy, dr.fma(k.uy, k.uy, k.vy * k.vy)
        return [k.ux, k.uy, k.vy, k.lo, *(dr.exp2(-2 * r) for r in ratios)]

    columns = [projection.x, projection.y, *shape(projection.kernels), *features]
    splats = _pack(columns, row_size(len(features)))
    if projection.pseudo is None:
        return Tables(splats, None, None, None)
    pseudo = _pack(shape(projection.pseudo), PSEUDO_ROW)
    dog_row, dog_index = (dr.detach(v, preserve_type=False) for v in (projection.dog_row, projection.dog_index))
    return Tables(splats, pseudo, dog_row, dog_index)
