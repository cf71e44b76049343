"""View-dependent colour of a mixed model: the bands above the constant one, a group of primitives for each degree.

A group is evaluated in lanes of its own, one for each of its rows, so that a primitive costs the bands that it has.
On the device its rows of 3, 8 or 15 coefficients are padded at the end to 4, 8 or 16, which are loaded four floats at
a time: with rows of degree 3 as they are, projection and derivative take 2.6 times as long.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from ..scene.row_groups import SH
from .device_camera import DeviceCamera
from .rows import read_rows
from .sh import unit_basis

ROW_COEFFICIENTS = {1: 4, 2: 8, 3: 16}
"""Coefficients in a row on the device, by degree of its group."""


def padded_rows(coefficients: np.ndarray) -> np.ndarray:
    """Rows [M, 3/8/15, 3] of a group as they are on the device, [M, 4/8/16, 3]."""
    k = coefficients.shape[1]
    return np.pad(coefficients, ((0, 0), (0, -k % 4), (0, 0)))


def padded_on_device(coefficients: mi.Float, degree: int) -> mi.Float:
    """The same of a flat array [M, 3/8/15, 3] of a group. Differentiable."""
    stored, wide = 3 * ((degree + 1) ** 2 - 1), 3 * ROW_COEFFICIENTS[degree]
    if stored == wide:
        return coefficients
    i = dr.arange(mi.UInt32, dr.width(coefficients) // stored * wide)
    row, column = i // wide, i % wide
    mode = dr.ReduceMode.NoConflicts
    return dr.gather(mi.Float, coefficients, dr.fma(row, stored, column), column < stored, mode=mode)


def sh_columns(coeffs: mi.Float, n: int, stored: int, start: int, stop: int) -> mi.Float:
    """Coefficients ``start`` to ``stop`` - 1 of [n, stored, 3], flat; zeros beyond those. Differentiable."""
    if (start, stop) == (0, stored):
        return coeffs
    size = 3 * (stop - start)
    i = dr.arange(mi.UInt32, n * size)
    row, column = i // size, i % size + 3 * start
    mode = dr.ReduceMode.NoConflicts
    return dr.gather(mi.Float, coeffs, dr.fma(row, stored * 3, column), column < stored * 3, mode=mode)


def has_groups(params: dict) -> bool:
    """Whether primitives have SH degrees of their own."""
    return any(group.index in params for group in SH.values())


def require_group(params: dict, degree: int) -> None:
    """Raise ``ValueError`` if no group of a mixed model has that degree, or a higher one."""
    highest = max(of_group for of_group, group in SH.items() if group.index in params)
    if highest < degree:
        raise ValueError(f"SH degree {degree} needs a group of it, the highest one is of degree {highest}")


def evaluate_groups(params: dict, camera: DeviceCamera, degree: int) -> list:
    """What the bands 1 to ``degree``, 1 to 3, add to the radiance, three channels of [N]; zero for who has none.

    Args:
        params: ``means`` [N, 3] and, for the groups that there are, ``sh1_index`` [M1] and ``sh1_coeffs`` [M1, 4, 3],
            ``sh2_index`` [M2] and ``sh2_coeffs`` [M2, 8, 3], ``sh3_index`` [M3] and ``sh3_coeffs`` [M3, 16, 3]. Only
            what ``degree`` needs is read, and only for primitives between the clipping planes.

    Raises ``ValueError`` if no group has that degree.
    """
    require_group(params, degree)
    n = dr.width(params["logit_opacities"])
    means = params["means"] * 1  # adjoints of groups add up apart from those of the projection, which need no wait
    rows = dr.zeros(mi.Float, 4 * n)  # of three channels and nothing, which are stored and loaded at once
    for of_group, group in SH.items():
        used = min(of_group, degree)
        if group.index in params:
            index, coefficients = params[group.index], params[group.names[0]]
            stride = 3 * ROW_COEFFICIENTS[of_group]
            added = mi.Vector4f(*_of_rows(means, camera, index, coefficients, stride, used), 0)
            dr.scatter(rows, added, index)
    return read_rows(rows, 4, 3, dr.arange(mi.UInt32, n))


def _of_rows(
    means: mi.Float, camera: DeviceCamera, index: mi.UInt32, coefficients: mi.Float, stride: int, used: int
) -> list:
    """Bands 1 to ``used`` of the rows of a group, of ``stride`` floats each: three channels of [M]; 0 out of sight."""
    camera = camera.at(index).in_each_lane(dr.width(index))
    direction = camera.offset(read_rows(means, 3, 3, index))
    visible = camera.in_range(camera.turned(direction, axis=2))
    basis = unit_basis(direction if camera.perspective else camera.rotation[2], used)[1:]
    row = dr.arange(mi.UInt32, dr.width(index))
    values = read_rows(coefficients, stride, 3 * len(basis), row, visible)
    channels = []
    for channel in range(3):
        color = basis[0] * values[channel]
        for k, b in enumerate(basis[1:], 1):
            color = dr.fma(b, values[3 * k + channel], color)
        channels.append(color)
    return channels
