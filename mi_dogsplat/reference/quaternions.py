"""Rotations of quaternions (x, y, z, w), and what comes back through them, in float64."""

from __future__ import annotations

import numpy as np


def rotations(quats: np.ndarray) -> np.ndarray:
    """Rotation matrices [N, 3, 3] of quaternions [N, 4] (x, y, z, w) of any length; 0 gives the identity."""
    length = np.linalg.norm(quats, axis=1, keepdims=True)
    unit = np.where(length > 0, quats / np.where(length > 0, length, 1), [0, 0, 0, 1])
    (x, y, z), w, zero = unit[:, :3].T, unit[:, 3, None, None], np.zeros(len(unit))
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)  # cross @ u = (x, y, z) x u
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def quats_backward(quats: np.ndarray, δω: np.ndarray) -> np.ndarray:
    """δquats [n, 4], xyzw, from ω = 2 Im(conj(q) dq) / |q|^2 in the axes of the primitive; 0 for a quaternion 0."""
    length = np.linalg.norm(quats, axis=1, keepdims=True)
    v, w = np.split(quats / np.where(length > 0, length, np.inf), [3], axis=1)
    δunit = 2 * np.concatenate([w * δω + np.cross(v, δω), -(v * δω).sum(1, keepdims=True)], axis=1)
    return δunit / np.where(length > 0, length, 1)
