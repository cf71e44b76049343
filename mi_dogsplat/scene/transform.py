"""Similarity transforms of a model: positions, orientations, sizes and the directions of its spherical harmonics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .row_groups import SH
from .sh_basis import sh_basis_table
from .splats import Splats


def decompose_similarity(matrix: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """(rotation [3,3], scale, translation [3]) of a 4x4 matrix.

    Raises ``ValueError`` unless the matrix is a rotation, a uniform positive scale and a translation.
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    linear, translation = matrix[:3, :3], matrix[:3, 3]
    det = np.linalg.det(linear) if np.isfinite(matrix).all() else 0.0
    scale = float(np.cbrt(det))
    if det <= 0 or not np.allclose(linear @ linear.T, scale**2 * np.eye(3), atol=1e-4 * scale**2):
        raise ValueError(
            "a model can be rotated, scaled uniformly and translated; this matrix shears, mirrors or collapses it"
        )
    return linear / scale, scale, translation


def quaternion_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product a b of quaternions [..., 4] in x, y, z, w order."""
    av, aw, bv, bw = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    vector = aw * bv + bw * av + np.cross(av, bv)
    return np.concatenate([vector, aw * bw - np.sum(av * bv, -1, keepdims=True)], -1)


def quaternion_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternion (x, y, z, w) of a rotation matrix: the leading eigenvector of Bar-Itzhack's symmetric matrix."""
    r = rotation
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[2, 0] + r[0, 2], r[2, 1] - r[1, 2]],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], r[2, 1] + r[1, 2], r[0, 2] - r[2, 0]],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    return np.linalg.eigh(k)[1][:, -1]


def sh_rotation(rotation: np.ndarray, degree: int) -> np.ndarray:
    """Matrix [K, K] that takes SH coefficients of f to those of f∘R⁻¹.

    Solved from samples: each band is a function space closed under rotation, so matching 2K directions is exact.
    """
    directions = np.random.default_rng(0).normal(size=(4 * (degree + 1) ** 2, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before, after = (sh_basis_table(d, degree) for d in (directions, directions @ rotation))  # rows: R⁻¹ d = d R
    return np.linalg.lstsq(before, after, rcond=None)[0]


def transformed(splats: Splats, matrix: np.ndarray) -> Splats:
    """The model moved by a 4x4 similarity. Exactly the same arrays for the identity.

    Raises ``ValueError`` for anything but rotation, uniform scale and translation.
    """
    rotation, scale, translation = decompose_similarity(matrix)
    if np.array_equal(np.asarray(matrix, dtype=np.float64), np.eye(4)):
        return splats
    turn = sh_rotation(rotation, splats.sh_degree)

    def turned(coeffs: np.ndarray, first: int) -> np.ndarray:
        """Rows of the coefficients from ``first`` on."""
        own = slice(first, first + coeffs.shape[1])
        return np.einsum("ij,njc->nic", turn[own, own], coeffs.astype(np.float64))

    groups = [group for group in SH.values() if len(getattr(splats, group.index))]
    of_groups = {name: turned(getattr(splats, name), 1) for group in groups for name in group.names}
    return replace(
        splats,
        means=splats.means.astype(np.float64) @ (scale * rotation).T + translation,
        log_scales=splats.log_scales + np.log(scale),
        quats=quaternion_product(quaternion_from_rotation(rotation), splats.quats.astype(np.float64)),
        sh_coeffs=turned(splats.sh_coeffs, 0),
        **of_groups,
    )
