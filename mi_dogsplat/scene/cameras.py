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

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

RIGID_TOLERANCE = 1e-3  # largest |R R^T - I| that is still rounding, not a scale or a shear
SCALE_TOLERANCE = 1e-6  # of a to_world, which is rounded to float32
DEFAULT_FAR_CLIP = 1e4  # of the sensors of Mitsuba
SQUARE_TOLERANCE = 1e-3  # largest relative difference of fx and fy that a Mitsuba sensor may swallow

OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
OPENCV_FROM_MITSUBA = np.diag([-1.0, -1.0, 1.0, 1.0])


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
        c2w = np.eye(4)
        c2w[:3, :3] = self.w2c[:3, :3].T
        c2w[:3, 3] = self.position
        return c2w

    @property
    def position(self) -> np.ndarray:
        """Centre of projection in world space, float64 [3]."""
        return -self.w2c[:3, :3].T @ self.w2c[:3, 3]

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

    def downscaled(self, k: int) -> Camera:
        """The camera of the image averaged over k x k blocks; the remainder at the right and bottom is cut
        off."""
        if k < 1 or min(self.width, self.height) < k:
            raise ValueError(f"Camera: a {self.width}x{self.height} image cannot be downscaled by {k}")
        return Camera(
            self.w2c, self.fx / k, self.fy / k, self.cx / k, self.cy / k, self.width // k, self.height // k
        )

    def resized(self, width: int, height: int) -> Camera:
        """The camera of the same picture resampled to width x height; each axis is scaled by its exact
        ratio."""
        x, y = width / self.width, height / self.height
        return Camera(self.w2c, self.fx * x, self.fy * y, self.cx * x, self.cy * y, width, height)


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
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = rotation, given[:3, 3]
    return rigid


def inverse_rigid(rigid: np.ndarray) -> np.ndarray:
    """Inverse of a rigid [4, 4] matrix."""
    inverse = np.eye(4)
    inverse[:3, :3] = rigid[:3, :3].T
    inverse[:3, 3] = -rigid[:3, :3].T @ rigid[:3, 3]
    return inverse


def opengl_c2w_to_opencv_w2c(c2w: ArrayLike) -> np.ndarray:
    """Camera-to-world with x right, y up, z backward -> OpenCV world-to-camera, [4, 4]. Raises
    ``ValueError``."""
    return OPENCV_FROM_OPENGL @ inverse_rigid(nearest_rigid(c2w))


def mitsuba_c2w_to_opencv_w2c(c2w: ArrayLike) -> np.ndarray:
    """Mitsuba ``to_world`` (x left, y up, z forward) -> OpenCV world-to-camera, [4, 4]. Raises
    ``ValueError``.

    A mirrored ``to_world`` (``<scale x="-1"/>``, common in converted scenes) is kept mirrored, as Mitsuba
    renders it.
    """
    return OPENCV_FROM_MITSUBA @ inverse_rigid(nearest_rigid(c2w, mirror=True))


def opencv_w2c_to_mitsuba_c2w(w2c: ArrayLike) -> np.ndarray:
    """OpenCV world-to-camera -> Mitsuba ``to_world`` (x left, y up, z forward), [4, 4]. Raises
    ``ValueError``."""
    return inverse_rigid(nearest_rigid(w2c, mirror=True)) @ OPENCV_FROM_MITSUBA


def camera_from_mitsuba(sensor: Any) -> Camera:
    """The ``Camera`` of a Mitsuba ``perspective`` sensor, crop window and principal point included.

    The image is the film's crop window. ``fov_axis`` and ``focal_length`` are resolved by the plugin itself,
    which shows the angle as ``x_fov`` over the whole film. Raises ``ValueError`` for any other sensor (a
    ``thinlens`` is no pinhole).
    """
    import mitsuba as mi

    if "principal_point_offset_x" not in mi.traverse(sensor):
        raise ValueError(f"{sensor.class_name()} is not a pinhole camera; use a sensor of type perspective")
    return central_camera_from_mitsuba(sensor)


def central_camera_from_mitsuba(sensor: Any) -> Camera:
    """``camera_from_mitsuba``, also for a ``thinlens`` sensor: the pinhole in the middle of its lens."""
    import mitsuba as mi

    parameters: Any = mi.traverse(sensor)
    film_width, film_height = (int(n) for n in sensor.film().size())
    width, height = (int(n) for n in sensor.film().crop_size())
    left, top = (int(n) for n in sensor.film().crop_offset())
    focal = 0.5 * film_width / math.tan(math.radians(_scalar(parameters["x_fov"])) / 2)
    # The offset is a fraction of the whole film, and moves the picture against its sign.
    offsets = [f"principal_point_offset_{axis}" for axis in "xy"]  # a lens has none
    offset_x, offset_y = (_scalar(parameters[name]) if name in parameters else 0.0 for name in offsets)
    cx, cy = film_width * (0.5 - offset_x) - left, film_height * (0.5 - offset_y) - top
    to_world = np.array(parameters["to_world"].matrix, dtype=np.float64).reshape(4, 4)
    return Camera(mitsuba_c2w_to_opencv_w2c(to_world), focal, focal, cx, cy, width, height)


def orthographic_camera_from_mitsuba(sensor: Any) -> Camera:
    """A Mitsuba ``orthographic`` sensor as a ``Camera`` whose fx and fy are in pixels per world unit.

    The film is 2 units wide in the sensor's own space, which ``to_world`` scales. Raises ``ValueError`` where it
    shears.
    """
    import mitsuba as mi

    parameters: Any = mi.traverse(sensor)
    to_world = np.array(parameters["to_world"].matrix, dtype=np.float64).reshape(4, 4)
    scales = np.linalg.norm(to_world[:3, :3], axis=0)  # [3]
    to_world[:3, :3] /= scales
    film_width, film_height = (int(n) for n in sensor.film().size())
    left, top = (int(n) for n in sensor.film().crop_offset())
    fx, fy = 0.5 * film_width / scales[:2]
    center = 0.5 * film_width - left, 0.5 * film_height - top
    return Camera(mitsuba_c2w_to_opencv_w2c(to_world), fx, fy, *center, *(int(n) for n in sensor.film().crop_size()))


def near_clip_from_mitsuba(sensor: Any) -> float:
    """Near clipping distance of a Mitsuba projective sensor, in world units along the optical axis."""
    return float(sensor.near_clip() * _depth_scale(sensor))


def far_clip_from_mitsuba(sensor: Any) -> float:
    """Far clipping distance, likewise; infinite where it is Mitsuba's default, which nobody chose."""
    return math.inf if sensor.far_clip() == DEFAULT_FAR_CLIP else float(sensor.far_clip() * _depth_scale(sensor))


def _depth_scale(sensor: Any) -> float:
    """By how much ``to_world`` scales depths, which it may for an orthographic sensor."""
    import mitsuba as mi

    parameters: Any = mi.traverse(sensor)
    axis = np.array(parameters["to_world"].matrix, dtype=np.float64).reshape(4, 4)[:3, 2]
    scale = float(np.linalg.norm(axis))
    return 1.0 if abs(scale - 1) < SCALE_TOLERANCE else scale


def camera_to_mitsuba(camera: Camera, near_clip: float = 0.01, far_clip: float = DEFAULT_FAR_CLIP) -> dict[str, Any]:
    """A ``perspective`` sensor dict for ``mi.load_dict`` that sees exactly what the camera sees. Needs a set
    variant.

    Mitsuba's pixels are square (one fov; a scaled ``to_world`` is refused). Where fx and fy differ by at most
    ``SQUARE_TOLERANCE`` the geometric mean is used, which moves a pixel by at most half the relative
    difference times its distance from the principal point; beyond that ``ValueError``.
    """
    import mitsuba as mi

    if abs(camera.fx / camera.fy - 1) > SQUARE_TOLERANCE:
        raise ValueError(
            f"fx={camera.fx:g} and fy={camera.fy:g} differ by more than {SQUARE_TOLERANCE:.1%}, but "
            "pixels of a Mitsuba sensor are square; resample the images so that fx = fy"
        )
    focal = math.sqrt(camera.fx * camera.fy)
    return {
        "type": "perspective",
        "fov": math.degrees(2 * math.atan(0.5 * camera.width / focal)),
        "fov_axis": "x",
        "principal_point_offset_x": 0.5 - camera.cx / camera.width,
        "principal_point_offset_y": 0.5 - camera.cy / camera.height,
        "near_clip": near_clip,
        "far_clip": far_clip,
        "to_world": mi.ScalarTransform4f(opencv_w2c_to_mitsuba_c2w(camera.w2c)),
        "film": {
            "type": "hdrfilm",
            "width": camera.width,
            "height": camera.height,
            "component_format": "float32",
            "rfilter": {"type": "box"},  # a pixel is the mean over its area, as in the data sets' downscaling
        },
    }


def _scalar(value: Any) -> float:
    """A parameter that is a float in scalar variants and a one-element array in the others."""
    return float(np.array(value).reshape(-1)[0])
