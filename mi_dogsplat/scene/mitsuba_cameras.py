"""Cameras as Mitsuba has them: poses, sensors and clipping distances, in both directions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..support.errors import Wrong
from .cameras import Camera, inverse_rigid, nearest_rigid

SCALE_TOLERANCE = 1e-6  # of a to_world, which is rounded to float32
DEFAULT_FAR_CLIP = 1e4  # of the sensors of Mitsuba
SQUARE_TOLERANCE = 1e-3  # largest relative difference of fx and fy that a Mitsuba sensor may swallow
OPENCV_FROM_MITSUBA = np.diag([-1.0, -1.0, 1.0, 1.0])


def mitsuba_c2w_to_opencv_w2c(c2w: ArrayLike) -> np.ndarray:
    """Mitsuba ``to_world`` (x left, y up, z forward) -> OpenCV world-to-camera, [4, 4]. Raises
    ``ValueError``.

    A mirrored ``to_world`` (``<scale x="-1"/>``, common in converted scenes) is kept mirrored, as Mitsuba
    renders it.
    """
    return OPENCV_FROM_MITSUBA @ inverse_rigid(nearest_rigid(c2w, mirror=True))


def opencv_w2c_to_mitsuba_c2w(w2c: ArrayLike) -> np.ndarray:
    """OpenCV world-to-camera -> Mitsuba ``to_world`` (x left, y up, z forward), [4, 4]. Raises ``ValueError``."""
    return inverse_rigid(nearest_rigid(w2c, mirror=True)) @ OPENCV_FROM_MITSUBA


def camera_from_mitsuba(sensor: Any) -> Camera:
    """The ``Camera`` of a Mitsuba ``perspective`` sensor, crop window and principal point included.

    The image is the film's crop window. ``fov_axis`` and ``focal_length`` are resolved by the plugin itself,
    which shows the angle as ``x_fov`` over the whole film. Raises ``Wrong`` for any other sensor (a
    ``thinlens`` is no pinhole), and ``ValueError`` for a ``to_world`` that is no pose.
    """
    import mitsuba as mi

    if "principal_point_offset_x" not in mi.traverse(sensor):
        raise Wrong(f"{sensor.class_name()} is not a pinhole camera", "use a sensor of type perspective")
    return central_camera_from_mitsuba(sensor)


def central_camera_from_mitsuba(sensor: Any) -> Camera:
    """``camera_from_mitsuba``, also for a ``thinlens`` sensor: the pinhole in the middle of its lens."""
    import mitsuba as mi

    parameters: Any = mi.traverse(sensor)
    film_width, film_height = (int(n) for n in sensor.film().size())
    width, height = (int(n) for n in sensor.film().crop_size())
    left, top = (int(n) for n in sensor.film().crop_offset())
    focal = 0.5 * film_width / math.tan(math.radians(_field_of_view(sensor, parameters)) / 2)
    # The offset is a fraction of the whole film, and moves the picture against its sign.
    offsets = [f"principal_point_offset_{axis}" for axis in "xy"]  # a lens has none
    offset_x, offset_y = (_scalar(parameters, name) if name in parameters else 0.0 for name in offsets)
    cx, cy = film_width * (0.5 - offset_x) - left, film_height * (0.5 - offset_y) - top
    to_world = _to_world(parameters)
    return Camera(mitsuba_c2w_to_opencv_w2c(to_world), focal, focal, cx, cy, width, height)


def orthographic_camera_from_mitsuba(sensor: Any) -> Camera:
    """A Mitsuba ``orthographic`` sensor as a ``Camera`` whose fx and fy are in pixels per world unit.

    The film is 2 units wide in the sensor's own space, which ``to_world`` scales. Raises ``ValueError`` where it
    shears.
    """
    import mitsuba as mi

    parameters: Any = mi.traverse(sensor)
    to_world = _to_world(parameters)
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
    axis = _to_world(parameters)[:3, 2]
    scale = float(np.linalg.norm(axis))
    return 1.0 if abs(scale - 1) < SCALE_TOLERANCE else scale


def camera_to_mitsuba(camera: Camera, near_clip: float = 0.01, far_clip: float = DEFAULT_FAR_CLIP) -> dict[str, Any]:
    """A ``perspective`` sensor dict for ``mi.load_dict`` that sees exactly what the camera sees. Needs a set
    variant.

    Mitsuba's pixels are square (one fov; a scaled ``to_world`` is refused). Where fx and fy differ by at most
    ``SQUARE_TOLERANCE`` the geometric mean is used, which moves a pixel by at most half the relative
    difference times its distance from the principal point. Raises ``ValueError`` beyond that, and for a pose that
    scales or shears.
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


def _field_of_view(sensor: Any, parameters: Any) -> float:
    """Over the whole film, degrees. Raises ``Wrong`` for one by which no focal length is finite and above 0."""
    angle = _scalar(parameters, "x_fov")
    if not 0 < angle < 180:  # NaN among them
        named = f' of the sensor "{sensor.id()}"' if sensor.id() and not sensor.id().startswith("_") else ""
        raise Wrong(f'"x_fov"{named} is {angle:g} degrees', "give a field of view above 0 and below 180")
    return angle


def _scalar(parameters: Any, name: str) -> float:
    """A parameter that is a float in scalar variants and a one-element array in the others."""
    return float(_one(np.array(parameters[name]).reshape(-1), name)[0])


def _to_world(parameters: Any) -> np.ndarray:
    """[4, 4] float64."""
    matrix = np.array(parameters["to_world"].matrix, dtype=np.float64).reshape(4, 4, -1)
    return _one(matrix, "to_world")[..., 0]


def _one(values: np.ndarray, name: str) -> np.ndarray:
    """What it is given, [..., 1]. Raises ``ValueError`` for several lanes."""
    if values.shape[-1] != 1:
        raise ValueError(f'a sensor has one "{name}", this one is {values.shape[-1]} lanes wide')
    return values
