"""What a scan is, whatever app has made it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...scene.cameras import RIGID_TOLERANCE, Camera, affine
from ...scene.quaternions import rotation_from_quaternion
from ...support.errors import DataError
from ..images import is_file

REMEDY = "export the scan again"


@dataclass(frozen=True, eq=False)
class ScanFrame:
    """One photograph of a scan.

    Attributes:
        number: of the frame in the video or the sequence, from 0, or the time at which it was taken.
        w2c: world to camera, OpenCV, float64 [4, 4], in metres.
        intrinsics: fx, fy, cx, cy in pixels.
        size: width and height of the images that these are of; None if they are those of the image.
        image: its file; None where it is a frame of ``Scan.video``.
        depth: the file of its depth map (``depth_files.py``); None without one.
        confidence: an image as large as the depth map, 0 where that is not to be trusted; None without one.
    """

    number: int
    w2c: np.ndarray
    intrinsics: tuple[float, float, float, float]
    size: tuple[int, int] | None = None
    image: Path | None = None
    depth: Path | None = None
    confidence: Path | None = None

    @property
    def name(self) -> str:
        """Of its image in a data set."""
        return f"frame_{self.number:06d}.jpg"

    def camera(self, width: int, height: int) -> Camera:
        """That of its image, which is so large. Raises ``ValueError`` for intrinsics that are none."""
        return Camera(self.w2c, *self.intrinsics, *(self.size or (width, height))).resized(width, height)


@dataclass(frozen=True, eq=False)
class Scan:
    """All frames of a scan, as they were taken.

    Attributes:
        app: the name of the app.
        frames: at least two.
        up: the direction [3] that is up; None if only the cameras tell.
        corrected: whether the app has corrected the poses, and removed the lens from the photographs, which leaves
            their borders black.
        keyframes: whether the app has chosen the frames; else they are all of a video.
        video: its file, if the frames are in one; its pixels lie as the sensor has them, whatever turn it asks for.
    """

    app: str
    frames: Sequence[ScanFrame]
    up: np.ndarray | None
    corrected: bool = False
    keyframes: bool = False
    video: Path | None = None


def pose_of(quaternion: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Camera to world [4, 4] of a quaternion [4] (x, y, z, w) and a place [3]. Raises ``ValueError`` for what is no
    pose."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = float(np.linalg.norm(quaternion))
    if not np.isfinite(place).all() or not abs(length - 1) < RIGID_TOLERANCE:
        raise ValueError(f"no pose: quaternion {quaternion.tolist()}, place {place.tolist()}")
    return affine(rotation_from_quaternion(quaternion[None])[0], place)


def existing(path: Path) -> Path | None:
    """A path if there is such a file."""
    return path if is_file(path) else None


def require_frames(path: Path, frames: Sequence[ScanFrame]) -> None:
    """Raise ``DataError`` for a scan of a single frame, or of none."""
    if len(frames) < 2:
        n = "a single photograph" if frames else "no photograph"
        raise DataError(path, f"is a scan with {n} that has a pose, and a model needs several", REMEDY)
