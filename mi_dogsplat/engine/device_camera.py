"""A camera as the kernels read it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from ..scene.cameras import Camera


@dataclass
class DeviceCamera:
    """A camera as opaque JIT scalars: one compiled kernel serves every camera and every image size.

    It is a pinhole, or, if not ``perspective``, sees along parallel rays; ``fx`` and ``fy`` are then in pixels per
    world unit and the limits mean nothing.
    """

    rotation: list  # W, 3 x 3
    position: list  # camera centre in world space, 3
    position_rest: list  # what float32 rounded off it
    fx: mi.Float
    fy: mi.Float
    cx: mi.Float
    cy: mi.Float
    limits: list  # x/z and y/z are clamped to [-left, right] x [-top, bottom] in J
    near_clip: mi.Float
    far_clip: mi.Float
    width: int
    height: int
    numbers: tuple  # all of the above on the host
    perspective: bool = True

    @staticmethod
    def upload(
        camera: Camera,
        near_clip: float = 0.2,
        far_clip: float = math.inf,
        film: tuple[float, float, float, float] | None = None,
        perspective: bool = True,
    ) -> DeviceCamera:
        """Host camera to device.

        ``film`` is the rectangle (left, top, right, bottom), in pixels of the camera, outside of which J is clamped:
        the whole image, of which the camera may see a crop window only. None: the camera's image.
        """
        x0, y0, x1, y1 = film or (0, 0, camera.width, camera.height)
        position = camera.position.astype(np.float32).astype(np.float64)
        margin_x, margin_y = 0.15 * (x1 - x0) / camera.fx, 0.15 * (y1 - y0) / camera.fy
        numbers = [
            *camera.w2c[:3, :3].ravel(), *position, *(camera.position - position),
            camera.fx, camera.fy, camera.cx, camera.cy,
            (camera.cx - x0) / camera.fx + margin_x, (x1 - camera.cx) / camera.fx + margin_x,
            (camera.cy - y0) / camera.fy + margin_y, (y1 - camera.cy) / camera.fy + margin_y,
            near_clip, far_clip,
        ]  # fmt: skip
        numbers = tuple(float(x) for x in numbers)
        packed = mi.Float(numbers)
        v = [dr.gather(mi.Float, packed, k) for k in range(len(numbers))]
        dr.eval(v)  # one launch makes them opaque
        fx, fy, cx, cy, *limits, near, far = v[15:]
        return DeviceCamera(
            rotation=[v[0:3], v[3:6], v[6:9]], position=v[9:12], position_rest=v[12:15],
            fx=fx, fy=fy, cx=cx, cy=cy, limits=limits, near_clip=near, far_clip=far,
            width=camera.width, height=camera.height, perspective=perspective,
            numbers=(*numbers, camera.width, camera.height, perspective),
        )  # fmt: skip

    def offset(self, points: list) -> list:
        """From the camera centre to points, before anything is multiplied: far from the origin W μ + t would cancel."""
        of_axes = zip(points, self.position, self.position_rest, strict=True)
        return [(point - position) - rest for point, position, rest in of_axes]

    def turned(self, offset: list, axis: int) -> mi.Float:
        """A coordinate in camera space of what ``offset`` gives; axis 2 is the depth."""
        W = self.rotation[axis]
        return dr.fma(W[0], offset[0], dr.fma(W[1], offset[1], W[2] * offset[2]))

    def in_range(self, depth: mi.Float) -> mi.Bool:
        """Beyond the near plane and before the far one; neither infinite nor NaN."""
        return (depth > self.near_clip) & (depth < self.far_clip)
