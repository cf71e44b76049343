"""Moving a model on the device: differentiable by the transform. ``scene/transform.py`` is its twin on the host.

The colours turn with the model: its spherical harmonics are rotated band by band. The matrix that does so is solved
from samples: each band is a space of functions that is closed under rotations and reflections, so matching as many
directions is exact.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from ..scene.row_groups import REVERSED, SH
from ..scene.sh_basis import sh_basis, sh_basis_table
from .in_each_lane import in_each_lane
from .rows import read_rows
from .sh_groups import ROW_COEFFICIENTS


def moved(params: dict, to_world: mi.Transform4f) -> dict:
    """Parameters (as ``upload`` makes them) of the model under a rotation, mirror, uniform scale and translation."""
    n = dr.width(params["logit_opacities"])
    if n == 0:
        return params
    matrix = [[to_world.matrix[r, c] for c in range(4)] for r in range(3)]
    signed = dr.cbrt(dr.det(mi.Matrix3f([row[:3] for row in matrix])))  # the scale, negative for a mirror image
    scale, rotation = dr.abs(signed), [[value / signed for value in row[:3]] for row in matrix]
    isometry = [[dr.mulsign(value, signed) for value in row] for row in rotation]
    # a mirror image turns the primitives' own axes round, and kernels are symmetric: a rotation is enough for these
    along_axes = {name: dr.mulsign(params[name], dr.detach(signed)) for name in REVERSED if name in params}
    return {
        **params,
        "means": _moved_points(params["means"], matrix, n),
        "quats": _turned_quats(params["quats"], rotation, n),
        "log_scales": params["log_scales"] + dr.log(scale),
        **along_axes,
        **_turned_colors(params, isometry, n),
    }


def _moved_points(means: mi.Float, matrix: list, n: int) -> mi.Float:
    x, y, z = read_rows(means, 3, 3, dr.arange(mi.UInt32, n))
    return _table([row[0] * x + row[1] * y + row[2] * z + row[3] for row in _rows_in_each_lane(matrix, n)])


def _turned_quats(quats: mi.Float, rotation: list, n: int) -> mi.Float:
    turn = cast(Any, dr.matrix_to_quat)(mi.Matrix3f(rotation))
    turn = cast(Any, mi.Quaternion4f)(in_each_lane([turn[i] for i in range(4)], n))
    *xyz, w = read_rows(quats, 4, 4, dr.arange(mi.UInt32, n))
    zero = (xyz[0] == 0) & (xyz[1] == 0) & (xyz[2] == 0) & (w == 0)  # read as the identity, which is not 0 in a product
    return _table(turn * cast(Any, mi.Quaternion4f)(*xyz, dr.select(zero, 1, w)))


def _turned_colors(params: dict, isometry: list, n: int) -> dict:
    """The arrays of SH coefficients that change, by their names."""
    turned = {}
    size = dr.width(params["sh_coeffs"]) // (3 * n)
    if size > 1:
        coefficients = read_rows(params["sh_coeffs"], 3 * size, 3 * size, dr.arange(mi.UInt32, n))
        turned["sh_coeffs"] = _table(_turned(coefficients, _rows_in_each_lane(isometry, n)))
    for degree, group in SH.items():
        if group.index in params:
            (name,), m = group.names, dr.width(params[group.index])
            stride, used = 3 * ROW_COEFFICIENTS[degree], 3 * ((degree + 1) ** 2 - 1)
            constant, padding = [mi.Float(0)] * 3, [mi.Float(0)] * (stride - used)
            bands = read_rows(params[name], stride, used, dr.arange(mi.UInt32, m))
            turned[name] = _table(_turned(constant + bands, _rows_in_each_lane(isometry, m))[3:] + padding)
    return turned


def _rows_in_each_lane(matrix: list, n: int) -> list:
    numbers, size = in_each_lane([value for row in matrix for value in row], n), len(matrix[0])
    return [numbers[k : k + size] for k in range(0, len(numbers), size)]


def _turned(coefficients: list, isometry: list) -> list:
    """Rows of SH coefficients (channels of a coefficient are neighbours) of f as those of f∘R⁻¹."""
    turned = coefficients[:3]
    for degree in range(1, round((len(coefficients) // 3) ** 0.5)):
        band = coefficients[3 * degree**2 : 3 * (degree + 1) ** 2]
        for row in _band_rotation(isometry, degree):
            turned += [sum(w * c for w, c in zip(row, band[channel::3], strict=True)) for channel in range(3)]
    return turned


def _band_rotation(isometry: list, degree: int) -> list[list]:
    """The matrix that takes coefficients of a band of f to those of f∘R⁻¹: values of the basis at R⁻¹ d, solved for
    the coefficients that give them at d."""
    size = 2 * degree + 1
    directions, solve = _samples(degree)
    back = [[sum(isometry[r][c] * d[r] for r in range(3)) for c in range(3)] for d in directions]  # R⁻¹ d
    values = [sh_basis(x, y, z, degree)[degree**2 :] for x, y, z in back]
    return [
        [sum(float(solve[k, i]) * values[i][j] for i in range(size)) for j in range(size)]
        for k in range(size)
    ]  # fmt: skip


@lru_cache
def _samples(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """(as many directions as a band has functions, what takes values there to coefficients), the best of some."""
    choices = []
    for seed in range(50):
        directions = np.random.default_rng(seed).normal(size=(2 * degree + 1, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        band = sh_basis_table(directions, degree)[:, degree**2 :]
        choices.append((np.linalg.cond(band), seed, directions, np.linalg.inv(band)))
    return min(choices, key=lambda choice: choice[:2])[2:]


def _table(columns) -> Any:
    """Columns as a flat row-major table."""
    return dr.ravel(cast(Any, mi.ArrayXf)(list(columns)), order="F")
