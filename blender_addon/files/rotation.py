"""Quaternions (w, x, y, z) and rotation matrices."""

from __future__ import annotations

import numpy as np


def quaternion_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product of quaternions [..., 4] in w, x, y, z order."""
    aw, av, bw, bv = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    w = aw * bw - np.sum(av * bv, axis=-1, keepdims=True)
    return np.concatenate([w, aw * bv + bw * av + np.cross(av, bv)], axis=-1)


def quaternion_from_rotation(r: np.ndarray) -> np.ndarray:
    """Unit quaternions [..., 4] (w, x, y, z) of rotation matrices [..., 3, 3].

    The leading eigenvector of Bar-Itzhack's symmetric matrix.
    """
    transposed, trace = r.swapaxes(-1, -2), np.trace(r, axis1=-2, axis2=-1)[..., None, None]
    k = np.zeros((*r.shape[:-2], 4, 4))
    k[..., 0, 0] = trace[..., 0, 0]
    for axis, (a, b) in enumerate(((2, 1), (0, 2), (1, 0)), 1):
        k[..., 0, axis] = k[..., axis, 0] = r[..., a, b] - r[..., b, a]
    k[..., 1:, 1:] = r + transposed - trace * np.eye(3)
    return np.linalg.eigh(k)[1][..., :, -1]


def rotations(quats: np.ndarray) -> np.ndarray:
    """Rotation matrices [N, 3, 3] of unit quaternions [N, 4]."""
    w, x, y, z = quats.T
    rows = ((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))  # fmt: skip
    return np.moveaxis(np.array(rows), 2, 0)
