"""The basis of real spherical harmonics up to degree 3, in the sign convention of 3D Gaussian Splatting."""

from __future__ import annotations

from typing import Any

import numpy as np

C0 = 0.28209479177387814  # 1 / (2 sqrt(pi)); colour = 0.5 + C0 * DC

SH_SIZES = (1, 4, 9, 16)
"""coefficients of a channel, by degree"""

SH_LEFT_OUT = "spherical harmonics of degree 4"
"""what files may have and models do not hold, as readers say it"""


def sh_degree_of(size: int) -> int:
    """The degree that has so many coefficients. Raises ``ValueError`` where none has."""
    return SH_SIZES.index(size)


def sh_basis(x: Any, y: Any, z: Any, degree: int) -> list:
    """Basis functions at unit directions, (degree + 1)² of them, ordered l² + l + m; the first is a plain number."""
    basis: list = [C0]
    if degree >= 1:
        c1 = 0.4886025119029199
        basis += [-c1 * y, c1 * z, -c1 * x]
    xx, yy, zz = x * x, y * y, z * z
    if degree >= 2:
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


def sh_basis_table(directions: np.ndarray, degree: int) -> np.ndarray:
    """The same on the host: [n, 3] float64 unit directions to [n, (degree + 1)²]."""
    x, y, z = directions.T
    return np.stack([np.broadcast_to(b, len(directions)) for b in sh_basis(x, y, z, degree)], axis=1)
