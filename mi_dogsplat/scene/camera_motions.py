"""Small rigid motions of cameras as six numbers each, and what all of them have in common.

A motion (ω, τ) takes a camera from its given pose to

    c2w' = c2w M,    M = | exp([ω]x)  e τ |
                         |     0       1  |

It acts on the right: ω, in radians, turns the camera about its own centre, and τ, in units of e, the extent of the
cameras (``camera_extent``), shifts that centre, both along the camera's own axes (OpenCV: right, down, forward).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .cameras import Camera

BLOCK = 4096  # points at a time, whose numbers stay in the cache of a core
U_BY_MOTION, V_BY_MOTION = np.zeros((2, 6, 9))  # from 1, u, v, u², u v, v², w, u w, v w (``_picture_motion``)
U_BY_MOTION[[0, 1, 1, 2, 3, 5], [4, 0, 3, 2, 6, 7]] = 1, -1, -1, 1, -1, 1
V_BY_MOTION[[0, 0, 1, 2, 4, 5], [0, 5, 4, 1, 6, 8]] = 1, 1, -1, -1, -1, 1
FEWEST_POINTS = 10  # for what a motion does to a picture
DAMPING = 0.1  # of the diagonal of Σ, as in CamP
SMALL = 1e-6  # radians, below which sin φ / φ and (1 - cos φ) / φ² are their limits
CANCELLING = 1e-2  # radians, below which φ - sin φ loses digits: there (φ - sin φ) / φ³ is two terms of its series
RANK = 1e-9  # of the largest singular value: a common motion that moves no camera, as a scale of cameras at one place


def moved_w2c(w2c: np.ndarray, motions: np.ndarray, extent: float) -> np.ndarray:
    """World-to-camera matrices [V, 4, 4] after motions [V, 6]: the inverse of M, times the given ones."""
    inverse = np.zeros((len(motions), 4, 4))
    inverse[:, :3, :3] = _turns(-motions[:, :3])
    inverse[:, :3, 3] = -np.einsum("vij,vj->vi", inverse[:, :3, :3], extent * motions[:, 3:])
    inverse[:, 3, 3] = 1
    return inverse @ w2c


def motion_gradient(w2c: np.ndarray, motions: np.ndarray, extent: float, by_pose: np.ndarray) -> np.ndarray:
    """Gradients by motions [V, 6], of those by what comes on top of them, [V, 6].

    ``by_pose`` is as of ``Nudge``: by a further turn exp([θ]x) on the right of M, and by the camera centre in world
    space. exp([ω + δ]x) = exp([ω]x) exp([J δ]x) to first order in δ, with the right Jacobian J of SO(3) (Solà et al.
    2018, A micro Lie theory, Eq. 143).
    """
    ω = motions[:, :3]
    _, first, second = _series(ω)
    turned = np.cross(ω, by_pose[:, :3])
    by_turn = by_pose[:, :3] + first[:, None] * turned + second[:, None] * np.cross(ω, turned)  # of J transposed
    by_shift = extent * np.einsum("vij,vj->vi", w2c[:, :3, :3], by_pose[:, 3:])
    return np.concatenate([by_turn, by_shift], axis=1)


def preconditioners(cameras: Sequence[Camera], points: np.ndarray, extent: float, nearest: float = 0.0) -> np.ndarray:
    """Matrices [V, 6, 6] from gradients by motions to motions that change the picture as the gradient asks for.

    As in CamP (Park et al. 2023): the inverse of Σ = mean of Jᵀ J, where J [2, 6] is how the picture of one of the
    ``points`` [P, 3] moves with the six numbers, in units of its longer side. A turn and a shift that look alike are
    told apart, and a shift of a camera that is far from everything is as long as it has to be. Points that are not
    deeper than ``nearest`` are not seen. Cameras that see too few points get the mean Σ of the others.
    """
    columns = np.ascontiguousarray(points.T)
    sums = np.array([_picture_motion(camera, columns, extent, nearest) for camera in cameras])  # [V, 6, 6]
    known = np.isfinite(sums).all(axis=(1, 2))
    usual = sums[known].mean(axis=0) if known.any() else np.eye(6)
    sums[~known] = usual
    diagonal = np.einsum("vii->vi", sums)
    damped = sums + np.eye(6) * (DAMPING * diagonal + 1e-12 * diagonal.max(axis=1, keepdims=True))[:, None]
    return np.linalg.inv(damped)


def _picture_motion(camera: Camera, points: np.ndarray, extent: float, nearest: float) -> np.ndarray:
    """Mean of Jᵀ J [6, 6] over the points [3, P] that the camera sees; NaN where these are too few.

    A camera that turns by ω and shifts by τ sees a point p, in its own axes, at p + p x ω - e τ. With u = x / z,
    v = y / z and w = e / z the derivatives of u and v by (ω, τ) are sums of ``terms``, whose products are summed here:
    hundreds of cameras see hundreds of thousands of points.
    """
    products = np.zeros((9, 9))
    for start in range(0, points.shape[1], BLOCK):
        x, y, z = camera.w2c[:3, :3] @ points[:, start : start + BLOCK] + camera.w2c[:3, 3:]  # [P] each
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # of points that are not in front
            u, v = x / z, y / z
            right, down = camera.fx * u + camera.cx, camera.fy * v + camera.cy
        seen = (z > nearest) & (right > 0) & (down > 0) & (right < camera.width) & (down < camera.height)
        inside = np.flatnonzero(seen)
        u, v, w = u[inside], v[inside], extent / z[inside]
        terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v, w, u * w, v * w])
        products += terms @ terms.T
    n, side = products[0, 0], max(camera.width, camera.height)
    if n < FEWEST_POINTS:
        return np.full((6, 6), np.nan)
    across, below = camera.fx / side * U_BY_MOTION, camera.fy / side * V_BY_MOTION
    return (across @ products @ across.T + below @ products @ below.T) / n


def common_motions(w2c: np.ndarray, extent: float) -> np.ndarray:
    """Orthonormal basis [6 V, 7 or fewer] of what a motion or scaling of the whole world does to all motions at once.

    To first order. No photograph can tell it: the model may move and grow along.
    """
    rotation = w2c[:, :3, :3]  # [V, 3, 3], world to camera
    centers = -np.einsum("vji,vj->vi", rotation, w2c[:, :3, 3])  # [V, 3]
    away = (centers - centers.mean(axis=0)) / extent
    columns = np.zeros((len(w2c), 6, 7))
    columns[:, 3:, :3] = rotation  # shifts along the world's axes
    columns[:, :3, 3:6] = rotation  # turns about them, in the middle of the cameras
    turned = np.cross(np.eye(3)[None], away[:, None])  # [V, axis, 3]
    columns[:, 3:, 3:6] = np.einsum("vij,vaj->via", rotation, turned)
    columns[:, 3:, 6] = np.einsum("vij,vj->vi", rotation, away)  # a scale
    basis, sizes, _ = np.linalg.svd(columns.reshape(-1, 7), full_matrices=False)
    return basis[:, sizes > RANK * sizes[0]]


def without_common(motions: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Motions [V, 6] less what they have in common."""
    flat = motions.ravel()
    return (flat - basis @ (basis.T @ flat)).reshape(motions.shape)


def _series(ω: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """sin φ / φ, (1 - cos φ) / φ² and (φ - sin φ) / φ³ of the lengths φ of rotation vectors [V, 3]."""
    φ = np.linalg.norm(ω, axis=1)  # [V]
    small, safe = φ < SMALL, np.maximum(φ, SMALL)
    half = np.sin(φ / 2) / safe
    return (
        np.where(small, 1.0, np.sin(φ) / safe),
        np.where(small, 0.5, 2 * half**2),
        np.where(φ < CANCELLING, 1 / 6 - φ**2 / 120, (φ - np.sin(φ)) / safe**3),
    )


def _turns(ω: np.ndarray) -> np.ndarray:
    """Rotation matrices [V, 3, 3] of rotation vectors [V, 3] (Rodrigues)."""
    first, second, _ = _series(ω)
    cross = np.cross(np.eye(3)[None], ω[:, None])  # rows e_a x ω: the matrix of [ω]x
    return np.eye(3) + first[:, None, None] * cross + second[:, None, None] * (cross @ cross)
