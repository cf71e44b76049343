"""Real spherical harmonics up to degree 3 as view-dependent colour, in the sign convention of 3D Gaussian Splatting."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

C0 = 0.28209479177387814  # 1 / (2 sqrt(pi)); colour = 0.5 + C0 * DC


def sh_basis(x, y, z, degree: int) -> list:
    """Basis functions at unit directions, (degree + 1)² of them, ordered l² + l + m."""
    basis: list = [C0]
    if degree >= 1:
        c1 = 0.4886025119029199
        basis += [-c1 * y, c1 * z, -c1 * x]
    if degree >= 2:
        xx, yy, zz = x * x, y * y, z * z
        basis += [
            1.0925484305920792 * (x * y),
            -1.0925484305920792 * (y * z),
            0.31539156525252005 * (2 * zz - xx - yy),
            -1.0925484305920792 * (x * z),
            0.5462742152960396 * (xx - yy),
        ]
    if degree >= 3:
        basis += [
            -0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * (x * y) * z,
            -0.4570457994644658 * y * (4 * zz - xx - yy),
            0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570457994644658 * x * (4 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3 * yy),
        ]
    return basis


def evaluate_sh(params: dict, direction: list, index: mi.UInt32, visible: mi.Bool, degree: int) -> list:
    """Colours max(0, SH(direction) + 0.5) of visible primitives, three channels of [N].

    Args:
        params: row-major ``sh_coeffs`` [N, K, 3], or, where the constant part is trained at its own rate, ``sh_dc`` [N, 3]
            and ``sh_rest`` [N, K - 1, 3]. Only what ``degree`` needs is read, and only for visible primitives.
        direction: from the camera centre to the primitive, not normalised.
    """
    x, y, z = direction
    norm2 = x * x + y * y + z * z
    inv = dr.rsqrt(dr.select(norm2 > 0, norm2, 1))  # a primitive on the camera centre has no direction: any will do
    basis = sh_basis(x * inv, y * inv, z * inv, degree)
    n = dr.width(index)
    split = "sh_dc" in params

    def coefficient(k: int, channel: int):
        name = ("sh_dc" if k == 0 else "sh_rest") if split else "sh_coeffs"
        column = 3 * (k - (split and k > 0)) + channel
        at = dr.fma(index, dr.width(params[name]) // n, column)
        return dr.gather(mi.Float, params[name], at, visible, mode=dr.ReduceMode.NoConflicts)

    colors = []
    for channel in range(3):
        color = mi.Float(0.5)
        for k, b in enumerate(basis):
            color = dr.fma(b, coefficient(k, channel), color)
        colors.append(dr.maximum(color, 0))
    return colors
