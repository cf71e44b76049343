"""What a visitor looks at, and when to render it: the viewer without a browser.

A camera that moves is answered at once with a small picture, one that rests with a full one. Whoever shows pictures
tells a ``Pace`` what happens and asks it what is due; it has no clock of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..scene.cameras import Camera, affine, inverse_rigid
from ..scene.quaternions import rotation_from_quaternion

REST_SECONDS = 0.25  # without movement, until the full picture is due
MOVING_SHARE = 0.4  # of the height, while the camera moves
SMALLEST = 16  # pixels
WIDEST = 8.0  # width over height of a full picture: a window that is pulled flat asks for hundreds

MODEL, WITHOUT_DOG, ONLY_DOG, ONLY_GAUSSIANS = "model", "DoG switched off", "only DoG", "only Gaussians"
VARYING = ("slopes", "curvatures", "slopes and curvatures")  # of a model, which are switched off together
WITHOUT_VARYING = {what: f"{what} switched off" for what in VARYING}
VARYING_DIFFERENCE = {what: f"{what} on and off: difference" for what in VARYING}
WITHOUT_CUTS, CUT_DIFFERENCE = "cuts switched off", "cuts on and off: difference"
WITHOUT_SHIFTS, SHIFT_DIFFERENCE = "shifts switched off", "shifts on and off: difference"
DOG_DIFFERENCE, ERROR, PHOTOGRAPH = "DoG on and off: difference", "error at nearest photograph", "nearest photograph"


@dataclass(frozen=True)
class Pose:
    """A visitor's camera: rotation camera to world as a quaternion, OpenCV axes (x right, y down, z forward)."""

    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    fov: float  # of the height, radians
    aspect: float  # width / height

    @property
    def makes_sense(self) -> bool:
        """Whether something can be seen from there: a browser may send what it could not compute."""
        return bool(np.isfinite([*self.wxyz, *self.position]).all()) and 0 < self.fov < math.pi

    def camera(self, height: int) -> Camera:
        """The pinhole of ``height`` pixels in rows, the principal point in the middle.

        A window wider than ``WIDEST`` has fewer rows, so that its picture is no larger; one without an area is square.
        """
        aspect = self.aspect if math.isfinite(self.aspect) else 1.0
        height = max(SMALLEST, min(height, round(height * WIDEST / aspect))) if aspect > WIDEST else height
        w, *vector = self.wxyz
        c2w = affine(rotation_from_quaternion(np.array([[*vector, w]]))[0], self.position)
        width = max(SMALLEST, round(height * aspect))
        focal = 0.5 * height / math.tan(self.fov / 2)
        return Camera(inverse_rigid(c2w), focal, focal, width / 2, height / 2, width, height)


@dataclass(frozen=True)
class Settings:
    """What is shown, and how."""

    show: str = MODEL
    height: int = 600  # of the full picture, pixels
    sh_degree: int = 3  # at most
    background: float = 0.0  # grey level
    gain: float = 4.0  # on errors, before they become colours

    def rows(self, moving: bool) -> int:
        """Height of the picture that is due."""
        return max(SMALLEST, round(self.height * (MOVING_SHARE if moving else 1)))


class Pace:
    """When a visitor's picture is due. Times are in seconds, of any clock."""

    def __init__(self):
        self._moved, self._small_due, self._full_due = -math.inf, False, False

    def moved(self, now: float) -> None:
        """The camera moved."""
        self._moved, self._small_due, self._full_due = now, True, True

    def changed(self) -> None:
        """The model or a setting changed: only the full picture would show it properly."""
        self._full_due = True

    def due(self, now: float) -> str | None:
        """``"full"``, ``"small"`` or nothing; taken as done."""
        if self._full_due and now - self._moved >= REST_SECONDS:
            self._small_due = self._full_due = False
            return "full"
        if self._small_due:
            self._small_due = False
            return "small"
        return None
