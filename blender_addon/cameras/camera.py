"""A camera as numbers, and what every reader of cameras needs.

A pose is OpenCV's world-to-camera (x right, y down, z forward); Blender's own cameras look along -z with y up.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..files.errors import FileError, told

OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
RIGID_TOLERANCE = 1e-3
SHARES, SMALL = (0.2, 0.8), 8  # as the package has them: where a principal point is in shares, and sides in pixels


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics in pixels (the centre of the first pixel is (0.5, 0.5)) and pose of an image.

    Of an orthographic one the rays are parallel, and fx and fy are pixels per unit. ``bent``: the photograph is by a
    lens that bends rays, and this is the pinhole of its focal lengths, which sees as it does in its middle. ``film``:
    of one that sees a part of a picture, all of that, (left, top, right, bottom) in its own pixels.
    """

    name: str
    w2c: np.ndarray  # [4, 4]
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    image: Path | None = None
    orthographic: bool = False
    bent: bool = False
    film: tuple[float, float, float, float] | None = None

    def downscaled(self, k: int) -> Camera:
        """The camera of the image averaged over k x k pixels, the remainder cut off."""
        values = {name: getattr(self, name) / k for name in ("fx", "fy", "cx", "cy")}
        return replace(self, **values, width=max(self.width // k, 1), height=max(self.height // k, 1))

    def window(self, left: int, top: int, right: int, bottom: int) -> Camera:
        """The camera of a part of the image, in whole pixels from its upper left corner."""
        x0, y0, x1, y1 = self.film or (0, 0, self.width, self.height)
        film = x0 - left, y0 - top, x1 - left, y1 - top
        return replace(self, cx=self.cx - left, cy=self.cy - top, width=right - left, height=bottom - top, film=film)

    def stretched(self, width: int, height: int) -> Camera:
        """The camera of the same picture in so many pixels."""
        x, y = width / self.width, height / self.height
        film = self.film and (self.film[0] * x, self.film[1] * y, self.film[2] * x, self.film[3] * y)
        lens = {"fx": self.fx * x, "fy": self.fy * y, "cx": self.cx * x, "cy": self.cy * y}
        return replace(self, **lens, width=width, height=height, film=film)


def require_pixels(cx: float, cy: float, width: int, height: int) -> None:
    """Raise ``ValueError`` for the principal point of a file that is in shares of the image's sides, as the package
    does: taken for pixels it is in a corner."""
    low, high = SHARES
    if low <= min(cx, cy) <= max(cx, cy) <= high and min(width, height) >= SMALL:
        problem = "cx {cx:g} and cy {cy:g} of an image of {size} are shares of its sides, not pixels"
        raise ValueError(told(problem, cx=cx, cy=cy, size=f"{width}x{height}"))


def rigid(path: Path, name: str, matrix: Any) -> np.ndarray:
    """A [3, 4] or [4, 4] matrix that is rigid up to rounding as an exactly rigid [4, 4] one. Raises ``FileError``."""
    try:
        given = np.array(matrix, np.float64)
        if given.shape not in ((3, 4), (4, 4)) or not np.isfinite(given).all():
            raise ValueError("its shape is not 4 x 4, or it is not finite")
        rotation = given[:3, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > RIGID_TOLERANCE or np.linalg.det(rotation) < 0:
            raise ValueError("it is not a rotation and a translation")
    except (ValueError, TypeError) as error:
        problem = 'the pose of "{name}" cannot be used ({reason})'
        raise FileError(path, problem, "correct it", name=name, reason=error) from error
    u, _, vt = np.linalg.svd(rotation)
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = u @ vt, given[:3, 3]
    return result


def unsheared(c2w: np.ndarray) -> np.ndarray:
    """The nearest [4, 4] pose without shear, mirrored or not, at the same place; the same array where it has none.

    Its axes have length 1. Parents that are scaled unevenly shear what is turned in them, and no pinhole sees so.
    """
    axes = c2w[:3, :3]
    if np.abs(axes.T @ axes - np.eye(3)).max() < RIGID_TOLERANCE:
        return c2w
    u, _, vt = np.linalg.svd(axes)
    found = c2w.copy()
    found[:3, :3] = u @ vt
    return found


def camera_name(file: str) -> str:
    """Name of the view of an image file: no extension, which begins with a letter, and no folder ``images`` or
    ``images_2``; ``/`` becomes ``_``."""
    path = Path(file.replace("\\", "/"))
    path = path.with_suffix("") if path.suffix[1:2].isalpha() else path
    parts = [part for part in path.parts if part not in (".", "..", "/")]
    return "_".join(parts[1:] if len(parts) > 1 and re.fullmatch(r"images(_\d+)?", parts[0]) else parts)
