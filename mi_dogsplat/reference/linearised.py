"""The perspective projection of centres and its Jacobian there, in float64, and the derivative of both.

Notation of `forward.py`. With the tangents (x / z, y / z) of a centre at (x, y, z) in camera space

    mu' = focal (x / z, y / z) + principal point,    J = focal / z [[1, 0, -x / z], [0, 1, -y / z]]

where J has the tangents clamped to at most 15 % of an image outside: far out the linearisation explodes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..scene.cameras import Camera

MARGIN = 0.15  # of an image


class Linearised:
    """Of centres [n, 3] in world space: `means2d` [n, 2] px, `z` [n, 1] and `JW` = J W [n, 2, 3]."""

    def __init__(self, camera: Camera, centres: np.ndarray):
        self.W, self.focal = camera.w2c[:3, :3], np.array([camera.fx, camera.fy])
        principal, size = np.array([camera.cx, camera.cy]), np.array([camera.width, camera.height])
        position = centres @ self.W.T + camera.w2c[:3, 3]
        self.z, self.tangents = position[:, 2:], position[:, :2] / position[:, 2:]
        self.means2d = self.focal * position[:, :2] / self.z + principal
        low, high = -(principal + MARGIN * size) / self.focal, (size - principal + MARGIN * size) / self.focal
        self.inside = (self.tangents > low) & (self.tangents < high)
        self.clamped = np.clip(self.tangents, low, high)
        J = np.zeros((len(centres), 2, 3))
        J[:, [0, 1], [0, 1]], J[:, :, 2] = self.focal / self.z, -self.focal * self.clamped / self.z
        self.JW = J @ self.W

    def backward(self, δmeans2d: np.ndarray, δJW: np.ndarray) -> np.ndarray:
        """δcentres [n, 3], by way of means2d [n, 2] and of J W [n, 2, 3].

        Both rows of J W are focal / z (W_0 - tangent W_2), the second one of W_1; through a clamp nothing comes.
        """
        bases = self.W[:2] - self.clamped[:, :, None] * self.W[2]  # [n, 2, 3]
        δfocal_by_z = (δJW * bases).sum(2)  # [n, 2]
        δtangents = self.focal * (δmeans2d - np.where(self.inside, δJW @ self.W[2], 0) / self.z)
        δz = -((δfocal_by_z * self.focal / self.z + δtangents * self.tangents) / self.z).sum(1, keepdims=True)
        return np.concatenate([δtangents / self.z, δz], axis=1) @ self.W
