"""A camera as the kernels read it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from ..scene.cameras import Camera
from .in_each_lane import in_each_lane

FARTHEST = 1e37  # world units of depth; 1/z of what is farther is no normal number, and its derivatives are NaN
MARGIN = 0.15  # of the image beyond each of its sides, where J still follows the centre: 1.3 x the field of view


@dataclass
class Nudge:
    """A motion of a camera by nothing: the gradients of its zeros add up, over the lanes, to those by the pose.

    A lane per primitive. With one value for all of them, Dr.Jit would add up the lanes at each of the two dozen places
    where a pose is used, by a kernel for each.
    """

    turn: list  # rotation vector about the camera's own axes, 3 x [N], radians
    shift: list  # of the camera centre in world space, 3 x [N]

    @staticmethod
    def of(n: int) -> Nudge:
        """For ``n`` primitives, attached to the AD graph."""
        turn, shift = ([dr.zeros(mi.Float, n) for _ in range(3)] for _ in range(2))
        dr.enable_grad(turn, shift)
        return Nudge(turn, shift)

    def at(self, index: mi.UInt32) -> Nudge:
        """That of some primitives, each of which is read once."""

        def gathered(values: list) -> list:
            return [dr.gather(mi.Float, value, index, mode=dr.ReduceMode.NoConflicts) for value in values]

        return Nudge(gathered(self.turn), gathered(self.shift))

    @property
    def values(self) -> list:
        """All six, turn first."""
        return [*self.turn, *self.shift]


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
    nudge: Nudge | None = None  # for derivatives by the pose, of as many lanes as ``offset`` is asked for

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
        margin_x, margin_y = MARGIN * (x1 - x0) / camera.fx, MARGIN * (y1 - y0) / camera.fy
        numbers = [
            *camera.w2c[:3, :3].ravel(), *position, *(camera.position - position),
            camera.fx, camera.fy, camera.cx, camera.cy,
            (camera.cx - x0) / camera.fx + margin_x, (x1 - camera.cx) / camera.fx + margin_x,
            (camera.cy - y0) / camera.fy + margin_y, (y1 - camera.cy) / camera.fy + margin_y,
            near_clip, min(far_clip, FARTHEST),
        ]  # fmt: skip
        numbers = tuple(float(x) for x in numbers)
        packed = mi.Float(numbers)
        v = [dr.gather(mi.Float, packed, k) for k in range(len(numbers))]
        dr.eval(v)  # copies of four bytes make them opaque, without a kernel
        fx, fy, cx, cy, *limits, near, far = v[15:]
        return DeviceCamera(
            rotation=[v[0:3], v[3:6], v[6:9]], position=v[9:12], position_rest=v[12:15],
            fx=fx, fy=fy, cx=cx, cy=cy, limits=limits, near_clip=near, far_clip=far,
            width=camera.width, height=camera.height, perspective=perspective,
            numbers=(*numbers, camera.width, camera.height, perspective),
        )  # fmt: skip

    def in_each_lane(self, n: int) -> DeviceCamera:
        """With its numbers as arrays of ``n`` lanes where they have derivatives: one for each that it is asked for."""
        numbers = [*self.rotation, self.position, [self.fx, self.fy, self.cx, self.cy], self.limits]
        if not dr.grad_enabled(numbers):
            return self
        arrays = iter(in_each_lane([value for row in numbers for value in row], n))
        *rotation, position, lens, limits = ([next(arrays) for _ in row] for row in numbers)
        fx, fy, cx, cy = lens
        return replace(self, rotation=rotation, position=position, fx=fx, fy=fy, cx=cx, cy=cy, limits=limits)

    def anonymous(self) -> DeviceCamera:
        """What the projection reads, the nudge apart: no numbers by which one camera could be told from another."""
        return replace(self, width=0, height=0, numbers=(), nudge=None)

    def offset(self, points: Iterable) -> list:
        """From the camera centre to points, before anything is multiplied: far from the origin W μ + t would cancel."""
        of_axes = zip(points, self.position, self.position_rest, strict=True)
        offset = [(point - position) - rest for point, position, rest in of_axes]
        if self.nudge:
            offset = [of_axis - shift for of_axis, shift in zip(offset, self.nudge.shift, strict=True)]
        return offset

    def at(self, index: mi.UInt32) -> DeviceCamera:
        """As it sees some of the primitives, each of which is read once."""
        return replace(self, nudge=self.nudge.at(index)) if self.nudge else self

    def axis(self, k: int) -> list:
        """Row ``k`` of W, 3: with a nudge by θ, of W - θ x W, since the camera's own axes turn by exp(θ)."""
        if not self.nudge:
            return self.rotation[k]
        θ, a, b = self.nudge.turn, (k + 1) % 3, (k + 2) % 3
        of_world = zip(self.rotation[k], self.rotation[a], self.rotation[b], strict=True)
        return [own - (θ[a] * in_b - θ[b] * in_a) for own, in_a, in_b in of_world]

    def turned(self, offset: list, axis: int) -> mi.Float:
        """A coordinate in camera space of what ``offset`` gives; axis 2 is the depth."""
        W = self.axis(axis)
        return dr.fma(W[0], offset[0], dr.fma(W[1], offset[1], W[2] * offset[2]))

    def in_range(self, depth: mi.Float) -> mi.Bool:
        """Beyond the near plane and before the far one; neither infinite nor NaN."""
        return (depth > self.near_clip) & (depth < self.far_clip)
