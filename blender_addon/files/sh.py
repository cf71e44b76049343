"""Real spherical harmonics up to degree 3, in the signs of 3D Gaussian splatting."""

from __future__ import annotations

import numpy as np

C0 = 0.28209479177387814


def sh_rotation(rotation: np.ndarray, degree: int) -> np.ndarray:
    """Matrix [K, K] from coefficients of f to those of f∘R⁻¹: each band is closed under rotations and reflections."""
    directions = np.random.default_rng(0).normal(size=(64, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before, after = sh_basis(directions, degree), sh_basis(directions @ rotation, degree)
    band = np.sqrt(np.arange((degree + 1) ** 2)).astype(int)
    return np.where(band[:, None] == band, np.linalg.lstsq(before, after, rcond=None)[0], 0.0)


def sh_basis(directions: np.ndarray, degree: int) -> np.ndarray:
    """Real spherical harmonics [P, K] at unit directions [P, 3], signs as in 3D Gaussian splatting."""
    x, y, z = directions.T
    terms = SH_TERMS[: (degree + 1) ** 2]
    columns = []
    for term in terms:
        column = np.zeros_like(x)
        for coefficient, i, j, k in term:
            column += coefficient * x**i * y**j * z**k
        columns.append(column)
    return np.stack(columns, axis=1)


# Each basis function as a polynomial: a sum of (coefficient, power of x, of y, of z). The node tree is built of it too.
_C1, _C2, _C3, _C4 = 0.4886025119029199, 1.0925484305920792, 0.31539156525252005, 0.5462742152960396
_D0, _D1, _D2, _D3, _D4 = (
    0.5900435899266435,
    2.890611442640554,
    0.4570457994644658,
    0.3731763325901154,
    1.445305721320277,
)
SH_TERMS: tuple[tuple[tuple[float, int, int, int], ...], ...] = (
    ((C0, 0, 0, 0),),
    ((-_C1, 0, 1, 0),),
    ((_C1, 0, 0, 1),),
    ((-_C1, 1, 0, 0),),
    ((_C2, 1, 1, 0),),
    ((-_C2, 0, 1, 1),),
    ((2 * _C3, 0, 0, 2), (-_C3, 2, 0, 0), (-_C3, 0, 2, 0)),
    ((-_C2, 1, 0, 1),),
    ((_C4, 2, 0, 0), (-_C4, 0, 2, 0)),
    ((-3 * _D0, 2, 1, 0), (_D0, 0, 3, 0)),
    ((_D1, 1, 1, 1),),
    ((-4 * _D2, 0, 1, 2), (_D2, 2, 1, 0), (_D2, 0, 3, 0)),
    ((2 * _D3, 0, 0, 3), (-3 * _D3, 2, 0, 1), (-3 * _D3, 0, 2, 1)),
    ((-4 * _D2, 1, 0, 2), (_D2, 3, 0, 0), (_D2, 1, 2, 0)),
    ((_D4, 2, 0, 1), (-_D4, 0, 2, 1)),
    ((-_D0, 3, 0, 0), (3 * _D0, 1, 2, 0)),
)
