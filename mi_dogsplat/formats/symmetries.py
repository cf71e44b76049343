"""The 24 ways to write down an ellipsoid: axes may be named in any order and turned round.

R S S Rᵀ stays what it is when R becomes R G and the scales are reordered with it, G one of the rotations of a cube.
Of the 24 quaternions the one nearest to the identity is taken. Its w is at least 0.85 and all others within ±0.39, so
that the index of the largest is always the same and the other codes are few: log2(24) = 4.6 bits less each.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from ..scene.quaternions import quaternion_product, rotation_from_quaternion, unit_quaternions
from ..scene.splats import Array, Splats


def _cube_rotations() -> tuple[Array, Array]:
    """Quaternions [24, 4] (x, y, z, w) of the rotations of a cube, and the axis [24, 3] that each axis comes from."""
    half = [np.array(q) / 2 for q in itertools.product((-1.0, 1), repeat=4) if q[3] > 0]
    units = list(np.eye(4))
    edges = []
    for i, j in itertools.combinations(range(4), 2):
        for sign in (-1.0, 1.0):
            q = np.zeros(4)
            q[j], q[i] = 1, sign
            edges.append(q / np.sqrt(2))
    quats = np.array([*units, *half, *edges])  # [24, 4]
    return quats, np.abs(rotation_from_quaternion(quats)).argmax(axis=1)


CUBE_QUATS, CUBE_AXES = _cube_rotations()


def nearest_to_identity(splats: Splats) -> Splats:
    """The same ellipsoids, each with the unit quaternion, w positive, that turns least; scales reordered."""
    quats = unit_quaternions(splats.quats)
    best = np.abs(_w_of_products(quats)).argmax(axis=1)  # [N]
    chosen = quaternion_product(quats, CUBE_QUATS[best])
    chosen *= np.where(chosen[:, 3:] < 0, -1, 1)
    scales = np.take_along_axis(splats.log_scales, CUBE_AXES[best], axis=1)
    return replace(splats, log_scales=scales, quats=chosen)


def _w_of_products(quats: Array) -> Array:
    """[N, 24] of the products of quaternions [N, 4] with those of the cube: all that tells how far they turn."""
    (x, y, z, w), (a, b, c, d) = quats.T[..., None], CUBE_QUATS.T
    return w * d - x * a - y * b - z * c
