"""Real spherical harmonics up to degree 3 as view-dependent colour, in the sign convention of 3D Gaussian Splatting.

``dr.sh_eval`` (Dr.Jit 1.5) has the same functions and would save 13 of the 785 operations of a projection at degree 3,
but it rounds otherwise: models would no longer train to the bits they have.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..scene.sh_basis import sh_basis
from .rows import read_rows


def unit(direction: list) -> list:
    """Directions of any length as unit vectors; one that has none stays zero."""
    x, y, z = direction
    norm2 = x * x + y * y + z * z
    inv = dr.rsqrt(dr.select(norm2 > 0, norm2, 1))  # a primitive on the camera centre has no direction
    return [x * inv, y * inv, z * inv]


def unit_basis(direction: list, degree: int) -> list:
    """``sh_basis`` at directions of any length."""
    x, y, z = unit(direction)
    return sh_basis(x, y, z, degree)


def evaluate_sh(params: dict, direction: list, index: mi.UInt32, visible: mi.Bool, degree: int) -> list:
    """SH(direction) + 0.5 of visible primitives, three channels of [N]; where negative it is shown as 0.

    Args:
        params: row-major ``sh_coeffs`` [N, K, 3], or, where the constant part is trained at its own rate, ``sh_dc``
            [N, 3] and ``sh_rest`` [N, K, 3] (whose constant part is not used: rows stay aligned for wide loads).
            Only what ``degree`` needs is read, and only for visible primitives.
        direction: from the camera centre to the primitive, not normalised.

    Raises ``ValueError`` if fewer coefficients are stored than ``degree`` needs.
    """
    basis = unit_basis(direction, degree)
    n, used = dr.width(index), 3 * len(basis)
    separate = "sh_dc" in params
    coefficients = read_rows(params["sh_dc"], 3, 3, index, visible) if separate else []
    if degree or not separate:
        name = "sh_rest" if separate else "sh_coeffs"
        stored = dr.width(params[name]) // n
        if stored < used:
            raise ValueError(f"SH degree {degree} needs {used // 3} coefficients per channel, {name} has {stored // 3}")
        coefficients += read_rows(params[name], stored, used, index, visible)[len(coefficients) :]
    colors = []
    for channel in range(3):
        color = mi.Float(0.5)
        for k, b in enumerate(basis):
            color = dr.fma(b, coefficients[3 * k + channel], color)
        colors.append(color)
    return colors
