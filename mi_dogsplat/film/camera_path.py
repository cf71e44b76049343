"""What a film follows: a camera for each moment, whatever it comes from."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..scene.cameras import Camera, inverse_rigid

DEFAULT_SIZE = (1280, 720)  # pixels
DEFAULT_SECONDS = 10.0
DEFAULT_FPS, LEAST_FPS, MOST_FPS = 30, 1, 240
WHOLE = 1e-6  # of a frame: nothing, but for rounding
DIGITS = 9  # of poses and lenses, that tell paths apart


@dataclass(frozen=True, eq=False)
class Lens:
    """A pose and a lens without pixels: ``c2w`` [4, 4], OpenCV axes; ``focal`` over the shorter side of the picture.

    ``offset``: of the principal point from the middle of the picture, to the right and down, over its shorter side.
    """

    c2w: np.ndarray
    focal: float
    offset: tuple[float, float] = (0.0, 0.0)

    def camera(self, width: int, height: int) -> Camera:
        """The camera of a picture of this size."""
        side = min(width, height)
        cx, cy = width / 2 + side * self.offset[0], height / 2 + side * self.offset[1]
        return Camera(inverse_rigid(self.c2w), side * self.focal, side * self.focal, cx, cy, width, height)


@dataclass(frozen=True, eq=False)
class CameraPath:
    """A way through the scene.

    Args:
        at: the lens at a share 0..1 of the way.
        closed: 1 is where 0 is, so that the film can be shown in a loop.
        what: the way in words.
        seconds: how long it takes, if it says so.
        size: width and height of the pictures, if it says so.
        fps: frames in a second, if it says so.
    """

    at: Callable[[float], Lens]
    closed: bool
    what: str
    seconds: float | None = None
    size: tuple[int, int] | None = None
    fps: int | None = None

    def frames(self, seconds: float | None, fps: float) -> tuple[int, float]:
        """(number of frames, how many steps between frames the way is long) of a film that takes so many seconds; None:
        as long as the way says, else ``DEFAULT_SECONDS``.

        A closed way has its last frame one step before the first one. An open one ends at its end; where it says how
        long it takes, its frames are at their own times instead, so that keys of another program are met when that
        program meets them.
        """
        if seconds is None and self.seconds is not None and not self.closed:
            steps = self.seconds * fps
            return int(steps + WHOLE) + 1, max(steps, WHOLE)
        n = max(1, round((seconds or self.seconds or DEFAULT_SECONDS) * fps))
        return n, float(n if self.closed else max(n - 1, 1))

    def moments(self, n: int, steps: float, shutter: float = 0.0, samples: int = 1) -> np.ndarray:
        """Shares of the way [n, samples] at which frames are exposed, as many and as far apart as ``frames`` says.

        ``shutter`` is the share of a step over which the samples spread, around the frame's own moment.
        """
        offsets = ((np.arange(samples) + 0.5) / samples - 0.5) * shutter  # [samples]
        shares = (np.arange(n)[:, None] + offsets) / steps  # [n, samples]
        return shares % 1.0 if self.closed else np.clip(shares, 0, 1)

    def read_at(self, moments: np.ndarray) -> CameraPath:
        """The same way at these shares of it (any shape) alone, with nothing left to read from its file: while a film
        is made, that may be written anew."""
        known = {share: self.at(share) for share in np.unique(moments).tolist()}
        return replace(self, at=known.__getitem__)

    def sha256(self, moments: np.ndarray) -> str:
        """Tells this way from others by its lenses at these shares of it (any shape).

        They count to ``DIGITS`` digits: the last ones may be others on another processor.
        """
        lenses = (self.at(float(share)) for share in moments.flat)
        numbers = (number for lens in lenses for number in (*lens.c2w[:3].flat, math.log(lens.focal), *lens.offset))
        rows = np.fromiter(numbers, np.float64).reshape(-1, 15)
        positions = rows[:, 3:12:4]  # [moments, 3]
        size = float(abs(positions).max()) or 1.0
        positions /= size
        digits = np.round(rows, DIGITS) + 0.0  # no -0.0
        return hashlib.sha256(f"{size:.{DIGITS}g}".encode() + digits.tobytes()).hexdigest()


def focal_of_fov(degrees: float) -> float:
    """Focal length over the shorter side of the picture, from the field of view of that side."""
    return 0.5 / math.tan(math.radians(degrees) / 2)


def focal_of_camera(camera: Camera) -> float:
    """Focal length over the shorter side of the picture."""
    return math.sqrt(camera.fx * camera.fy) / min(camera.width, camera.height)


def offset_of_camera(camera: Camera) -> tuple[float, float]:
    """That of the principal point from the middle of the picture, over its shorter side."""
    side = min(camera.width, camera.height)
    return (camera.cx - camera.width / 2) / side, (camera.cy - camera.height / 2) / side
