"""Projected primitives as the rows that the compositor reads."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

import drjit as dr
import mitsuba as mi

from .arrays import array_types, detached
from .curvatures import COLUMNS as CURVATURE_COLUMNS
from .cuts import COLUMNS as CUT_COLUMNS
from .options import Settings
from .project import Projection
from .screen_kernels import Kernels
from .slopes import COLUMNS as SLOPE_COLUMNS


class KernelRow(namedtuple("KernelRow", "ux uy vy lo q s t")):
    """A 2D kernel as lanes evaluate it: p = lo - (ux dx + uy dy)² - (vy dy)², and ratios (``kernel_values.py``)."""


class CentredKernel(namedtuple("CentredKernel", "x y ux uy vy lo")):
    """A 2D kernel and its centre: what blending has derivatives by, or these derivatives, in this order. Features and
    what varies over a primitive follow."""

    def centre_plus(self, δx: Any, δy: Any) -> CentredKernel:
        return self._replace(x=self.x + δx, y=self.y + δy)


N_PSEUDO = 4  # the last of these are the pseudo-Gaussian's own; its centre is that of the primary
KERNEL_COLUMNS = len(KernelRow._fields)
FIRST_FEATURE = 2 + KERNEL_COLUMNS  # column of the primitives' table: x, y, kernel, features, what varies, padding
PSEUDO_COLUMNS = 8  # of the pseudo-Gaussians' table: kernel, padding
DEPTH_FEATURE = 3  # the feature after the colours, in views that stop at a depth


@dataclass
class SplatRow:
    """A primitive as lanes read it; in the table in this order."""

    x: Any
    y: Any
    kernel: KernelRow
    features: list
    slopes: list  # gx of the three colours, then gy; none where no colour varies
    curvatures: list  # qxx, qxy, qyy; none where no brightness curves
    cuts: list  # hx, hy of each plane; none where no primitive is cut

    @staticmethod
    def of(columns: list, settings: Settings) -> SplatRow:
        x, y, *kernel = columns[:FIRST_FEATURE]
        return SplatRow(x, y, KernelRow(*kernel), *parts_of(columns[FIRST_FEATURE:], settings))


def parts_of(columns: list, settings: Settings) -> tuple[list, list, list, list]:
    """(features, slopes, curvatures, cuts) of a row, or what belongs to them: columns in this order."""
    sizes = settings.n_features, settings.slopes * SLOPE_COLUMNS, settings.curvatures * CURVATURE_COLUMNS
    ends = [0, *accumulate(sizes)]
    features, slopes, curvatures = (columns[a:b] for a, b in pairwise(ends))
    return features, slopes, curvatures, columns[ends[-1] :]


@dataclass
class Tables:
    """Projected primitives, row-major, one or two cache lines each; what the compositor reads."""

    splats: mi.Float  # [N, row_size]
    pseudo: mi.Float | None  # [M, PSEUDO_COLUMNS]
    dog_row: mi.UInt32 | None  # [N]
    dog_index: mi.UInt32 | None  # [M]
    stop_depth: mi.Float | None = None  # [H*W], primitives with a larger DEPTH_FEATURE are not blended


def varying_columns(settings: Settings) -> int:
    """Floats of a row for what varies over primitives."""
    of_colors = settings.slopes * SLOPE_COLUMNS + settings.curvatures * CURVATURE_COLUMNS
    return of_colors + settings.cuts * CUT_COLUMNS


def columns_used(settings: Settings) -> int:
    """Floats of a row in the table, without padding."""
    return FIRST_FEATURE + settings.n_features + varying_columns(settings)


def row_size(settings: Settings) -> int:
    """Floats per primitive in the table: whole cache lines, in which every eight are aligned."""
    return -(-columns_used(settings) // 16) * 16


def pack(projection: Projection, features: list, settings: Settings) -> Tables:
    """Lay out a projection for the compositor (detached: derivatives are passed by hand, see ``rasterize.py``).

    ``settings``: those of the view, which say what there is (``view.arrange``).
    """
    columns = [projection.x, projection.y, *_kernel_columns(projection.kernels), *features, *projection.varying]
    splats = _table(columns, row_size(settings))
    if projection.pseudo is None:
        return Tables(splats, None, None, None)
    pseudo = _table(_kernel_columns(projection.pseudo), PSEUDO_COLUMNS)
    return Tables(splats, pseudo, detached(projection.dog_row), detached(projection.dog_index))


def _kernel_columns(k: Kernels) -> KernelRow:
    ratios = k.ux * k.ux, k.ux * k.uy, dr.fma(k.uy, k.uy, k.vy * k.vy)
    return KernelRow(k.ux, k.uy, k.vy, k.lo, *(dr.exp2(-2 * r) for r in ratios))


def _table(columns: Any, stride: int) -> Any:
    """Columns, detached, as a row-major table with rows of ``stride`` floats."""
    types = array_types()
    n = max(dr.width(c) for c in columns)
    table = dr.empty(types.Float, n * stride)
    index = dr.arange(types.UInt, n)
    for k, column in enumerate(columns):
        dr.scatter(table, detached(column), dr.fma(index, stride, k), mode=dr.ReduceMode.Permute)
    return table
