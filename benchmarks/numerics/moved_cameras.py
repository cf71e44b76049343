"""Motions by six numbers, on the device and on the host, and the float64 cameras that see what moved sensors see.

The six are shifts along three axes in world units, then rotations about them in degrees.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from mi_dogsplat.plugin.samples import samples
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.mitsuba_cameras import OPENCV_FROM_MITSUBA, opencv_w2c_to_mitsuba_c2w
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

FAR = 1e6  # units from where a pinhole sees as along parallel rays


def device_motion(p: Any) -> Any:
    """Rotation about x, then y, then z, then translation, of six variables on the device."""
    move: Any = mi.Transform4f()
    return move.translate(mi.Point3f(*p[:3])).rotate([0, 0, 1], p[5]).rotate([0, 1, 0], p[4]).rotate([1, 0, 0], p[3])


def host_motion(p: ArrayLike) -> np.ndarray:
    """The same in float64, [4, 4]."""
    numbers = np.asarray(p, np.float64)
    return affine(Rotation.from_euler("xyz", numbers[3:], degrees=True).as_matrix(), numbers[:3])


def posed(camera: Camera, p: ArrayLike) -> Camera:
    """The camera after a motion in its own space, along the axes of Mitsuba's sensors."""
    c, c2w = camera, opencv_w2c_to_mitsuba_c2w(camera.w2c) @ host_motion(p)
    return Camera(OPENCV_FROM_MITSUBA @ np.linalg.inv(c2w), c.fx, c.fy, c.cx, c.cy, c.width, c.height)


def of_moved_world(camera: Camera, p: ArrayLike, scale: float = 1.0) -> Camera:
    """The camera that sees of a model what this one sees of it scaled about the origin and then moved.

    Colours that depend on the view turn along; a pinhole cannot tell a larger model from a nearer one.
    """
    c, w2c = camera, camera.w2c @ host_motion(p)
    w2c[:3, 3] /= scale
    return Camera(w2c, c.fx, c.fy, c.cx, c.cy, c.width, c.height)


def far_pinhole(camera: Camera, p: ArrayLike, size: float) -> Camera:
    """What an orthographic sensor ``2 size`` units wide at the place of ``camera``, moved by ``p``, sees: from far."""
    far = opencv_w2c_to_mitsuba_c2w(camera.w2c) @ host_motion(p)
    far[:3, 3] -= FAR * far[:3, 2]
    f, w, h = 0.5 * camera.width / size * FAR, camera.width, camera.height
    return Camera(OPENCV_FROM_MITSUBA @ np.linalg.inv(far), f, f, 0.5 * w, 0.5 * h, w, h)


def lens_pinholes(camera: Camera, radius: float, focus: float, p: ArrayLike, spp: int, seed: int) -> list[Camera]:
    """The pinholes, one per pass of a render, whose mean is what a thin lens moved by ``p`` sees."""
    pinholes = []
    for s in samples(spp, seed):
        warped = mi.warp.square_to_uniform_disk_concentric(mi.ScalarPoint2f(s.lens_x, s.lens_y))
        point = -radius * np.array([float(np.array(v).ravel()[0]) for v in warped])
        w2c = np.array(posed(camera, p).w2c)
        w2c[:2, 3] -= point
        shift = camera.fx * point / focus + 0.5 - np.array([s.x, s.y])
        center = camera.cx + shift[0], camera.cy + shift[1]
        pinholes.append(Camera(w2c, camera.fx, camera.fy, *center, camera.width, camera.height))
    return pinholes
