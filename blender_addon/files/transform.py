"""Similarity transforms of a model: positions, orientations, sizes and the directions of its spherical harmonics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .model import Model, normalized

C0 = 0.28209479177387814


def transformed(model: Model, matrix: np.ndarray) -> Model:
    """The model moved by a [4, 4] similarity; the very same model for the identity.

    Raises ``ValueError`` for anything but rotation, uniform positive scale and translation.
    """
    matrix = np.asarray(matrix, np.float64)
    if np.abs(matrix - np.eye(4)).max() < 1e-7:
        return model
    linear = matrix[:3, :3]
    scale = similarity_scale(linear)
    rotation = linear / scale
    turn = sh_rotation(rotation, model.sh_degree)
    quats = quaternion_product(quaternion_from_rotation(rotation), normalized(model.quats).astype(np.float64))
    return replace(
        model,
        means=(model.means.astype(np.float64) @ linear.T + matrix[:3, 3]).astype(np.float32),
        log_scales=(model.log_scales + np.log(scale)).astype(np.float32),
        quats=quats.astype(np.float32),
        sh_coeffs=np.einsum("ij,njc->nic", turn, model.sh_coeffs.astype(np.float64)).astype(np.float32),
    )


def similarity_scale(linear: np.ndarray) -> float:
    """The scale of a [3, 3] rotation with uniform scale; ``ValueError`` for any other matrix."""
    det = np.linalg.det(linear)
    scale = float(np.cbrt(det))
    if not det > 0 or np.abs(linear @ linear.T - scale**2 * np.eye(3)).max() > 1e-4 * scale**2:
        raise ValueError("splats can be rotated, scaled uniformly and moved, but this object is sheared, mirrored, "
                         "flattened or scaled differently along its axes")  # fmt: skip
    return scale


def quaternion_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product of quaternions [..., 4] in w, x, y, z order."""
    aw, av, bw, bv = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    w = aw * bw - np.sum(av * bv, axis=-1, keepdims=True)
    return np.concatenate([w, aw * bv + bw * av + np.cross(av, bv)], axis=-1)


def quaternion_from_rotation(r: np.ndarray) -> np.ndarray:
    """Unit quaternion (w, x, y, z) of a rotation matrix: the leading eigenvector of Bar-Itzhack's symmetric matrix."""
    k = np.zeros((4, 4))
    k[0, 0] = np.trace(r)
    k[0, 1:] = k[1:, 0] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    k[1:, 1:] = r + r.T - np.trace(r) * np.eye(3)
    return np.linalg.eigh(k)[1][:, -1]


def sh_rotation(rotation: np.ndarray, degree: int) -> np.ndarray:
    """Matrix [K, K] that takes coefficients of f to those of f∘R⁻¹: each band is closed under rotation."""
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
