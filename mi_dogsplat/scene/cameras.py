"""Pinhole cameras, and converters whose names state both conventions.

Conventions (camera space; all right-handed, so they differ by a half turn about one axis):

=========  =========================  ===================================
name       x, y, z                    used by
=========  =========================  ===================================
opencv     right, down, forward       COLMAP and everything inside here
opengl     right, up, backward        ``transforms.json``, Blender, NeRF
mitsuba    left, up, forward          Mitsuba's ``to_world`` of a sensor
=========  =========================  ===================================

Pixel (i, j), column i and row j counted from the top left, has its centre at (i + 0.5, j + 0.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

RIGID_TOLERANCE = 1e-3  # largest |R R^T - I| that is still rounding, not a scale or a shear
SAME_PLACE = 1e-9  # by which positions, which follow from poses, may differ: world units, or a share of the largest

SHARES = 0.2, 0.8  # of the sides of an image, between which a principal point is
SMALL = 8  # pixels of a side, below which such numbers may be pixels

OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def require_pixels(cx: float, cy: float, width: int, height: int) -> None:
    """Raise ``ValueError`` for the principal point of a file that is in shares of the image's sides, as some programs
    have it: taken for pixels it is in the first one, in a corner."""
    low, high = SHARES
    if low <= min(cx, cy) <= max(cx, cy) <= high and min(width, height) >= SMALL:
        raise ValueError(f"cx {cx:g} and cy {cy:g} of an image of {width}x{height} are shares of its sides, not pixels")


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera in the OpenCV convention (x right, y down, z forward).

    ``w2c`` is float64 [4, 4], world to camera, rigid. ``fx, fy, cx, cy`` are in pixels; a centred principal
    point is ``cx = width / 2``. Raises ``ValueError`` for a wrong shape, a value that is not finite, or a
    size or focal length that is not positive.
    """

    w2c: np.ndarray
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        w2c = np.array(self.w2c, dtype=np.float64)
        if w2c.shape != (4, 4):
            raise ValueError(f'Camera: "w2c" has shape {w2c.shape}, expected (4, 4)')
        if not (np.isfinite(w2c).all() and np.isfinite([self.fx, self.fy, self.cx, self.cy]).all()):
            raise ValueError("Camera: the pose or the intrinsics contain a value that is not finite")
        if min(self.fx, self.fy) <= 0:
            raise ValueError(f"Camera: focal lengths must be positive, got fx={self.fx}, fy={self.fy}")
        if min(self.width, self.height) < 1:
            raise ValueError(f"Camera: the image must have a pixel, got {self.width}x{self.height}")
        w2c.setflags(write=False)
        object.__setattr__(self, "w2c", w2c)

    @property
    def c2w(self) -> np.ndarray:
        """Camera to world, float64 [4, 4]."""
        return inverse_rigid(self.w2c)

    @property
    def position(self) -> np.ndarray:
        """Centre of projection in world space, float64 [3]."""
        return self.c2w[:3, 3]

    @property
    def K(self) -> np.ndarray:
        """Intrinsic matrix in pixels, float64 [3, 3]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def project(self, points: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Project world points [P, 3] to (pixels [P, 2], depth [P]), in float64.

        Depth is z in camera space; where it is not positive the point lies behind and its pixel means
        nothing.
        """
        world = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        local = world @ self.w2c[:3, :3].T + self.w2c[:3, 3]  # [P, 3]
        depth = local[:, 2]  # [P]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            pixels = local[:, :2] / depth[:, None] * (self.fx, self.fy) + (self.cx, self.cy)  # [P, 2]
        return pixels, depth

    def unproject(self, pixels: ArrayLike, depth: ArrayLike) -> np.ndarray:
        """World points [..., 3] that pixels [..., 2] see at a depth [...], in float64: the inverse of ``project``."""
        z = np.asarray(depth, dtype=np.float64)[..., None]
        xy = (np.asarray(pixels, dtype=np.float64) - (self.cx, self.cy)) / (self.fx, self.fy) * z
        return np.concatenate([xy, z], axis=-1) @ self.c2w[:3, :3].T + self.position

    def downscaled(self, k: int) -> Camera:
        """The camera of the image averaged over k x k blocks; the remainder at the right and bottom is cut off."""
        if k < 1 or min(self.width, self.height) < k:
            raise ValueError(f"Camera: a {self.width}x{self.height} image cannot be downscaled by {k}")
        return Camera(self.w2c, self.fx / k, self.fy / k, self.cx / k, self.cy / k, self.width // k, self.height // k)

    def resized(self, width: int, height: int) -> Camera:
        """The camera of the same picture resampled to width x height; each axis is scaled by its exact ratio."""
        x, y = width / self.width, height / self.height
        return Camera(self.w2c, self.fx * x, self.fy * y, self.cx * x, self.cy * y, width, height)


def spread_of(cameras: Sequence[Camera]) -> float:
    """Largest distance of a camera from the mean of all, world units; 0 where they are at one place up to rounding."""
    positions = np.array([camera.position for camera in cameras])  # [V, 3]
    spread = float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).max())
    return spread if spread > SAME_PLACE * max(1.0, float(np.abs(positions).max())) else 0.0


def nearest_rigid(matrix: ArrayLike, mirror: bool = False) -> np.ndarray:
    """The rigid float64 [4, 4] matrix nearest to one ([3, 4] or [4, 4]) that is rigid up to rounding.

    ``mirror`` admits a reflection. Raises ``ValueError`` for values that are not finite, a wrong last row, a
    scale or shear above ``RIGID_TOLERANCE``, or a reflection: those are mistakes in the data that must not be
    smoothed over.
    """
    given = np.asarray(matrix, dtype=np.float64)
    if given.shape not in ((3, 4), (4, 4)):
        raise ValueError(f"the pose has shape {given.shape}, expected (4, 4)")
    if not np.isfinite(given).all():
        raise ValueError("the pose contains a value that is not finite")
    if given.shape == (4, 4) and np.abs(given[3] - (0, 0, 0, 1)).max() > RIGID_TOLERANCE:
        raise ValueError("the last row of the pose is not 0 0 0 1")
    with np.errstate(over="ignore", invalid="ignore"):  # of huge values
        deviation = np.abs(given[:3, :3] @ given[:3, :3].T - np.eye(3)).max()
    if not deviation <= RIGID_TOLERANCE:
        raise ValueError(f"the pose is not a rotation: R R^T differs from the identity by {deviation:.2g}")
    u, _, vt = np.linalg.svd(given[:3, :3])
    rotation = u @ vt  # [3, 3]
    if np.linalg.det(rotation) < 0 and not mirror:
        raise ValueError("the pose is not a rotation but a reflection (determinant -1)")
    return affine(rotation, given[:3, 3])


def affine(linear: ArrayLike, translation: ArrayLike = (0, 0, 0)) -> np.ndarray:
    """The map x -> ``linear`` x + ``translation`` as a float64 matrix [4, 4]."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, translation
    return matrix


def inverse_rigid(rigid: np.ndarray) -> np.ndarray:
    """Inverse of a rigid [4, 4] matrix."""
    return affine(rigid[:3, :3].T, -rigid[:3, :3].T @ rigid[:3, 3])


def opengl_c2w_to_opencv_w2c(c2w: ArrayLike) -> np.ndarray:
    """Camera-to-world with x right, y up, z backward -> OpenCV world-to-camera, [4, 4]. Raises ``ValueError``."""
    return OPENCV_FROM_OPENGL @ inverse_rigid(nearest_rigid(c2w))
