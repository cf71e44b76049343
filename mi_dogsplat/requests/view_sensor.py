"""A camera of a request as a sensor of Mitsuba."""

from __future__ import annotations

import math
from typing import Any

import mitsuba as mi
import numpy as np

from ..plugin.sensor import Rectangle
from ..scene.mitsuba_cameras import opencv_w2c_to_mitsuba_c2w
from .view_request import ViewRequest

NEAREST = 1e-4  # Mitsuba takes no near clip of 0


def sensor_of(request: ViewRequest, rows: slice | None = None) -> mi.Sensor:
    """It sees what the camera sees, whose pixels are taken as square (``fx``), or some rows of it.

    Its film is no larger, as Mitsuba compiles kernels for each size of one.
    """
    camera = request.camera
    assert camera
    rows = rows or slice(0, camera.height)
    film: dict[str, Any] = {"type": "hdrfilm", "width": camera.width, "height": camera.height, "pixel_format": "rgba",
                            "component_format": "float32", "rfilter": {"type": "box"}}  # fmt: skip
    film |= {"crop_offset_y": rows.start, "crop_height": rows.stop - rows.start}
    near, far = request.clip
    common: dict[str, Any] = {"near_clip": max(near, NEAREST), "far_clip": far, "film": film}
    if request.orthographic:
        w2c = camera.w2c.copy()
        w2c[:2, 3] += (camera.cx - camera.width / 2) / camera.fx, (camera.cy - camera.height / 2) / camera.fx
        half = camera.width / 2 / camera.fx  # of the film is 1 in the space of the sensor
        to_world = opencv_w2c_to_mitsuba_c2w(w2c) @ np.diag([half, half, 1.0, 1.0])
        found: Any = mi.load_dict({"type": "orthographic", "to_world": mi.ScalarTransform4f(to_world), **common})
        return found
    shift = {"principal_point_offset_x": 0.5 - camera.cx / camera.width,
             "principal_point_offset_y": 0.5 - camera.cy / camera.height}  # fmt: skip
    fov = math.degrees(2 * math.atan(camera.width / (2 * camera.fx)))
    to_world: Any = mi.ScalarTransform4f(opencv_w2c_to_mitsuba_c2w(camera.w2c))
    found = mi.load_dict({"type": "perspective", "fov_axis": "x", "fov": fov, "to_world": to_world, **shift, **common})
    return found


def picture_of(request: ViewRequest, rows: slice) -> Rectangle:
    """The picture of which the camera sees a part, in pixels of some rows of that part."""
    assert request.camera
    left, top, right, bottom = request.film or (0.0, 0.0, float(request.camera.width), float(request.camera.height))
    return left, top - rows.start, right, bottom - rows.start
