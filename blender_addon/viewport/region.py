"""What a viewport sees, as a camera of the package, exactly where Blender draws its overlays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..cameras.camera import OPENCV_FROM_OPENGL, Camera, unsheared
from .projection import projection_of

Part = tuple[int, int, int, int]
FAR = 1e30  # where single precision knows no end of the view


@dataclass(frozen=True, eq=False)
class Seen:
    """A camera, and the near and far end of what it sees, from there on."""

    camera: Camera
    clip: tuple[float, float]

    def same(self, other: Seen | None) -> bool:
        """Whether another one sees the same."""
        return other is not None and _numbers(self) == _numbers(other)

    def scaled(self, share: float) -> Seen:
        """With so much of the pixels along each axis."""
        camera = self.camera
        width, height = max(round(camera.width * share), 1), max(round(camera.height * share), 1)
        return replace(self, camera=camera.stretched(width, height))

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """[P, 2] of points [P, 3] in the world, from the upper left corner."""
        camera = self.camera
        local = points @ camera.w2c[:3, :3].T + camera.w2c[:3, 3]
        plane = local[:, :2] if camera.orthographic else local[:, :2] / local[:, 2:]
        return plane * (camera.fx, camera.fy) + (camera.cx, camera.cy)

    def rectangle(self, points: np.ndarray) -> tuple[float, float, float, float]:
        """(left, top, right, bottom) in pixels around points [P, 3] in the world."""
        pixels = self.pixels(points)
        (left, top), (right, bottom) = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
        return left, top, right, bottom

    def of_picture(self, corners: np.ndarray | None) -> Seen:
        """As a part of the picture with these corners [4, 3] in the world, which may be smaller; None: of its own.

        Splats far off the picture of a camera have the shapes that they have in its render.
        """
        return self if corners is None else replace(self, camera=replace(self.camera, film=self.rectangle(corners)))

    def window(self, left: int, top: int, right: int, bottom: int) -> Seen:
        """A part of the picture, in whole pixels from its upper left corner."""
        return replace(self, camera=self.camera.window(left, top, right, bottom))


def seen_by(space: Any, width: int, height: int) -> Seen:
    """What a region of so many pixels sees: ``space`` is its ``RegionView3D``."""
    w2c, (focal, center) = np.array(space.view_matrix, np.float64), projection_of(space, width, height)
    if (rigid := unsheared(w2c)) is not w2c:  # of a camera, which stays in its place
        rigid[:3, 3] = rigid[:3, :3] @ np.linalg.pinv(w2c[:3, :3]) @ w2c[:3, 3]
        w2c = rigid
    a, b = np.array(space.window_matrix, np.float64)[2, 2:]
    if space.is_perspective:
        clip = b / (a - 1), b / (a + 1) if a < -1 else FAR
    else:
        near = (-1 - b) / a  # along the view's z axis, which points at the viewer
        w2c[2, 3] -= near  # behind all that is seen
        clip = 0.0, -2 / a
    numbers = *focal, *center, width, height
    camera = Camera("viewport", OPENCV_FROM_OPENGL @ w2c, *numbers, orthographic=not space.is_perspective)
    return Seen(camera, (float(clip[0]), float(clip[1])))


def _numbers(seen: Seen) -> tuple:
    camera = seen.camera
    numbers = camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height
    return *camera.w2c.ravel().tolist(), *numbers, camera.orthographic, camera.film, *seen.clip


def rendered_part(seen: Seen, corners: np.ndarray | None, border: tuple[float, ...] | None) -> Part:
    """The part of a region that is rendered, as (left, top, right, bottom) in whole pixels; at least one of them.

    border: smallest and largest x, smallest and largest y, as shares from the lower left; None: all of the region.
    corners: [4, 3] in the world of the picture of the camera that the region looks through, of which they are shares;
    None: they are of the region.
    """
    width, height = seen.camera.width, seen.camera.height
    if border is None:
        return 0, 0, width, height
    x0, y0, x1, y1 = 0.0, 0.0, float(width), float(height)
    if corners is not None:
        x0, y0, x1, y1 = seen.rectangle(corners)
    left, right = (x0 + share * (x1 - x0) for share in border[:2])
    bottom, top = (y1 + share * (y0 - y1) for share in border[2:])
    left, top = min(max(round(left), 0), width - 1), min(max(round(top), 0), height - 1)
    return left, top, min(max(round(right), left + 1), width), min(max(round(bottom), top + 1), height)
