"""Quaternions (x, y, z, w) and rotation matrices, on the host."""

from __future__ import annotations

import numpy as np

XYZW_FROM_WXYZ, WXYZ_FROM_XYZW = [1, 2, 3, 0], [3, 0, 1, 2]
"""columns of the one order in the other, in which most files have them"""


def quaternion_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product a b of quaternions [..., 4] in x, y, z, w order: the rotation b, then a."""
    ax, ay, az, aw = np.moveaxis(a, -1, 0)
    bx, by, bz, bw = np.moveaxis(b, -1, 0)
    parts = (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
    return np.stack(parts, axis=-1)


def rotated(vectors: np.ndarray, quats: np.ndarray) -> np.ndarray:
    """Vectors [N, 3] turned by quaternions [N, 4] of any length; zero turns nothing."""
    q = quats / np.maximum(np.linalg.norm(quats, axis=1, keepdims=True), 1e-30)
    axis, w = q[:, :3], q[:, 3:]
    turn = np.cross(axis, vectors)
    return vectors + 2 * (w * turn + np.cross(axis, turn))


def quaternion_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternions [..., 4] (x, y, z, w) of rotation matrices [..., 3, 3].

    The leading eigenvector of Bar-Itzhack's symmetric matrix.
    """
    r = np.moveaxis(rotation, (-2, -1), (0, 1))
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[2, 0] + r[0, 2], r[2, 1] - r[1, 2]],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], r[2, 1] + r[1, 2], r[0, 2] - r[2, 0]],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    return np.linalg.eigh(np.moveaxis(k, (0, 1), (-2, -1)))[1][..., :, -1]


def unit_quaternions(quats: np.ndarray) -> np.ndarray:
    """Quaternions [N, 4] (x, y, z, w) of length 1, float64, which turn as those of any length do; zero is the
    identity."""
    quats = quats.astype(np.float64)  # in float32 the square of a length need not be finite
    lengths = np.linalg.norm(quats, axis=1, keepdims=True)  # [N, 1]
    return np.where(lengths > 0, quats / np.where(lengths > 0, lengths, 1), [0.0, 0, 0, 1])


def rotation_from_quaternion(quats: np.ndarray) -> np.ndarray:
    """Rotation matrices [N, 3, 3] of quaternions [N, 4] of any length; zero is the identity."""
    squared = (quats**2).sum(axis=1)  # [N]
    x, y, z, w = (quats / np.sqrt(np.where(squared == 0, 1, squared))[:, None]).T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), 2, 0)
