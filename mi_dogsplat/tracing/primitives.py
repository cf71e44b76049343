"""What rays need of N primitives, made of their raw parameters by operations that Dr.Jit differentiates.

Notation (3DGRT, Moenne-Loccoz et al. 2024; method paper, Sec. 3)
    μ, R, s     centre, rotation, scales of a primitive
    M           sqrt(log2(e) / 2) S⁻¹ Rᵀ: takes an offset from μ to where all kernels are 2^-|x|²
    lo          log2 of the opacity; a kernel is 2^(lo - |M (x - μ)|²)
    F, f_a      of a DoG primitive: its pseudo-Gaussian has F⁻¹ M for M, and lo_p = lo + log2 f_a
    w           S⁻¹ Rᵀ (x - μ), a point in standard deviations along the axes; where a colour varies it is
                c + Σ_a w_a slope_a + ½ wᵀ Q w, Q being the same for all channels
    n           of a plane that cuts a primitive off: its kernels are multiplied by g(n·w) (docs/cuts.md)
    A, v̄        of a primitive whose place depends on the view: on a ray along d it stands at m + G d (``shifts.py``)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.activations import all_finite, rotation_matrix, softplus
from ..engine.rows import NO_ROW, read_rows, rows
from ..engine.screen_kernels import LOG2_E
from ..engine.sh_groups import ROW_COEFFICIENTS, has_groups, require_group, sh_columns
from ..engine.shifts import ROW as SHIFT_SIZE
from ..engine.shifts import VIEW_ROW, shift
from ..scene.row_groups import CURVATURES, PLANES, SH, SHIFTS, SLOPES, RowGroup

PER_DEVIATION = (0.5 * LOG2_E) ** 0.5  # |M (x - μ)| of a point that is one standard deviation away
MAX_LOG_SCALE = 27.0  # scales are kept within e^±27, so that squares of what is divided by them are floats
SPARSE = "pseudo", "slopes", "curvatures", "normals", "shifts"  # in ``Primitives``, with a row for some of them only


@dataclass
class PlaneRows:
    """Which primitives a plane cuts off, and where its normals are."""

    row: mi.UInt32  # [N] row of the normals or NO_ROW
    index: mi.UInt32  # [C] its inverse


@dataclass
class Primitives:
    """Columns of N primitives; of their pseudo-Gaussians, where there are any, a row per DoG primitive; of slopes, of
    curvatures, of the normals of a plane and of shifts a row per primitive that has them."""

    to_kernel: list  # M, nine columns, row-major
    mean: list  # μ, three; m of a primitive that has a shift
    lo: mi.Float
    sh: mi.Float  # [N, K, 3] of one degree, flat
    usable: mi.Bool  # everything finite (but for logit opacities)
    pseudo: list  # F⁻¹ and lo_p, four columns of [M]; empty without DoG
    dog_row: mi.UInt32 | None  # [N] row of the pseudo-Gaussian or NO_ROW
    dog_index: mi.UInt32 | None  # [M] its inverse
    slopes: list  # nine columns of [S], axis by axis, three channels each; empty without
    slope_row: mi.UInt32 | None  # [N] row of the slopes or NO_ROW
    curvatures: list  # Q, six columns of [B]; empty without
    curvature_row: mi.UInt32 | None  # [N] row of the curvatures or NO_ROW
    normals: list  # n of each plane, three columns of [C] each; empty without cuts
    planes: list[PlaneRows]
    shifts: list  # G, nine columns of [V], row by row; empty without
    shift_row: mi.UInt32 | None  # [N] row of the shifts or NO_ROW

    @property
    def kernel(self) -> list:
        """M, μ and lo, 13 columns."""
        return [*self.to_kernel, *self.mean, self.lo]

    def with_tangents(self) -> Primitives:
        """The same in forward mode: columns with the tangents that reach them now, from which no edge leads back."""
        columns = [*self.kernel, self.sh, *(c for name in SPARSE for c in getattr(self, name))]
        dr.forward_to(columns, flags=dr.ADFlag.ClearNone)  # some columns are on the way to others
        leaves = [mi.Float(dr.detach(column)) for column in columns]
        dr.enable_grad(leaves)
        for leaf, column in zip(leaves, columns, strict=True):
            dr.set_grad(leaf, dr.grad(column))
        rest = iter(leaves[14:])
        sparse = {name: [next(rest) for _ in getattr(self, name)] for name in SPARSE}
        return replace(self, to_kernel=leaves[:9], mean=leaves[9:12], lo=leaves[12], sh=leaves[13], **sparse)


def primitives_of(params: dict, sh_degree: int) -> Primitives:
    """Raw parameters (flat arrays, as ``parameters.upload`` makes them) as rays need them; at least one primitive.

    Raises ``ValueError`` if fewer SH coefficients are stored than ``sh_degree`` needs.
    """
    n = dr.width(params["logit_opacities"])
    index = dr.arange(mi.UInt32, n)
    quats, log_scales = read_rows(params["quats"], 4, 4, index), rows(params["log_scales"], 3, index)
    R = rotation_matrix(quats)
    mean, shifts, shift_row = _places(params, rows(params["means"], 3, index), R, log_scales)
    inverse = [PER_DEVIATION * _exp_minus(s) for s in log_scales]
    to_kernel = [inverse[k] * R[c][k] for k in range(3) for c in range(3)]
    lo = -LOG2_E * softplus(-params["logit_opacities"])
    sh = uniform_sh(params, sh_degree)
    broken = dr.block_sum(dr.select(dr.isfinite(dr.detach(sh)), mi.Float(0), mi.Float(1)), dr.width(sh) // n)
    usable = all_finite([*mean, *log_scales, *quats]) & ~dr.isnan(lo) & (broken == 0)
    slopes, slope_row = _columns_of(params, SLOPES)
    curvatures, curvature_row = _columns_of(params, CURVATURES)
    of_groups, normals, planes = [(slopes, slope_row), (curvatures, curvature_row), (shifts, shift_row)], [], []
    for group in (group for group in PLANES if group.index in params):
        columns, row = _columns_of(params, group)
        of_groups.append((columns, row))
        normals += columns
        planes.append(PlaneRows(row, params[group.index]))
    for columns, row in of_groups:
        if row is not None:
            usable &= _of_row(all_finite(columns), row)
    pseudo, dog_row, dog_index = [], None, None
    if "dog_index" in params:
        dog_row, dog_index = params["dog_row"], params["dog_index"]
        pseudo, finite = _pseudo(params, lo)
        usable &= _of_row(finite, dog_row)
    return Primitives(to_kernel, mean, lo, sh, usable, pseudo, dog_row, dog_index, slopes, slope_row, curvatures,
                      curvature_row, normals, planes, shifts, shift_row)  # fmt: skip


def _pseudo(params: dict, lo: mi.Float) -> tuple[list, mi.Bool]:
    """(F⁻¹ and lo_p of the M DoG primitives, whether all of them are numbers); ``lo`` of the N primaries."""
    index = params["dog_index"]
    log_factors = rows(params["dog_log_scales"], 3, dr.arange(mi.UInt32, dr.width(index)))
    of_primary = dr.gather(mi.Float, lo, index, mode=dr.ReduceMode.NoConflicts)
    pseudo_lo = of_primary - LOG2_E * softplus(-params["dog_logit_opacities"])
    return [*(_exp_minus(f) for f in log_factors), pseudo_lo], all_finite(log_factors) & ~dr.isnan(pseudo_lo)


def _places(params: dict, mean: list, R: list, log_scales: list) -> tuple[list, list, Any]:
    """(m, columns of G, [N] their rows) of primitives at ``mean``; (``mean``, [], None) in a model without shifts."""
    if SHIFTS.index not in params:
        return mean, [], None
    index, row = params[SHIFTS.index], params[SHIFTS.row]
    dr.eval(R, log_scales)  # in one kernel: a gather launches one for what is not evaluated yet

    def of(value: mi.Float) -> mi.Float:
        return dr.gather(mi.Float, value, index, mode=dr.ReduceMode.NoConflicts)

    axes, scales = [[of(x) for x in row] for row in R], [_exp_minus(-of(s)) for s in log_scales]
    v = dr.arange(mi.UInt32, dr.width(index))
    A, mean_views = rows(params["view_shifts"], SHIFT_SIZE, v), rows(params["mean_views"], VIEW_ROW, v)
    there, none = mi.Bool(True), [0, 0, 0]
    columns = [shift(unit, axes, scales, A, none, there) for unit in ([1, 0, 0], [0, 1, 0], [0, 0, 1])]
    back = shift(none, axes, scales, A, mean_views, there)
    dr.eval(columns, back)
    here = row != NO_ROW
    moved = [dr.gather(mi.Float, x, row, here, mode=dr.ReduceMode.Permute) for x in back]
    G = [column[k] for k in range(3) for column in columns]
    return [a + b for a, b in zip(mean, moved, strict=True)], G, row


def _columns_of(params: dict, group: RowGroup) -> tuple[list, Any]:
    """(columns of what primitives have in a group, [N] their rows); ([], None) in a model without."""
    if group.index not in params:
        return [], None
    ((name, shape),) = group.arrays.items()
    columns = rows(params[name], math.prod(shape), dr.arange(mi.UInt32, dr.width(params[group.index])))
    return columns, params[group.row]


def _of_row(finite: mi.Bool, row: mi.UInt32) -> mi.Bool:
    """[N] whether what primitives have in a group is finite; true of those that are not in it."""
    return (row == NO_ROW) | dr.gather(mi.Bool, finite, row, row != NO_ROW)


def _exp_minus(x: mi.Float) -> mi.Float:
    return dr.exp(-dr.clip(x, -MAX_LOG_SCALE, MAX_LOG_SCALE))


def uniform_sh(params: dict, degree: int) -> mi.Float:
    """[N, (degree + 1)², 3] coefficients of all primitives, flat; zeros where one has none. Differentiable."""
    n, size = dr.width(params["logit_opacities"]), (degree + 1) ** 2
    stored = dr.width(params["sh_coeffs"]) // (3 * n)
    if not has_groups(params):
        if stored < size:
            raise ValueError(f"SH degree {degree} needs {size} coefficients per channel, sh_coeffs has {stored}")
        return sh_columns(params["sh_coeffs"], n, stored, 0, size)
    require_group(params, degree)
    sh = sh_columns(params["sh_coeffs"], n, 1, 0, size)
    for of_group, group in SH.items():
        if group.index in params and degree:
            count = 3 * ((min(of_group, degree) + 1) ** 2 - 1)
            i = dr.arange(mi.UInt32, dr.width(params[group.index]) * count)
            row, column = i // count, i % count
            at = dr.fma(row, 3 * ROW_COEFFICIENTS[of_group], column)
            values = dr.gather(mi.Float, params[group.names[0]], at, mode=dr.ReduceMode.NoConflicts)
            into = dr.fma(dr.gather(mi.UInt32, params[group.index], row), 3 * size, column + 3)
            dr.scatter(sh, values, into, mode=dr.ReduceMode.Permute)
    return sh
