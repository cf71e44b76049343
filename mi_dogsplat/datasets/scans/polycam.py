"""Polycam's raw data: an image, a camera and a depth map for each keyframe, called by the time of it.

``keyframes/`` holds ``images/``, ``cameras/*.json``, ``depth/*.png`` in millimetres and ``confidence/*.png`` with 0 for
low, 127 and 255; and after loop closure ``corrected_images/``, without distortion and so with black borders, and
``corrected_cameras/``. Poses are camera-to-world, OpenGL, row by row, in the world of ARKit, whose y is up. Source: the
README of github.com/PolyCam/polyform.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...scene.cameras import opengl_c2w_to_opencv_w2c
from ...support.errors import DataError
from ...support.files import read_object
from .scan import REMEDY, Scan, ScanFrame, existing, require_frames

APP = "Polycam"
PARTS = ("corrected_", "")  # the better first, of the names of folders


def find(path: Path) -> Path | None:
    """The folder of keyframes of a scan, which may be given itself; None if ``path`` is no such scan."""
    return next((folder for folder in (path / "keyframes", path) if _kinds(folder)), None)


def read(keyframes: Path) -> Scan:
    """The scan of a folder of keyframes, of those that have an image. Raises ``DataError``."""
    kinds = _kinds(keyframes)
    part = next((part for part in kinds if _numbered(keyframes / f"{part}cameras")), kinds[-1])
    cameras = _numbered(keyframes / f"{part}cameras")
    frames = [_frame(keyframes, part, number, file) for number, file in sorted(cameras.items())]
    found = [frame for frame in frames if frame.image]
    require_frames(keyframes, found)
    return Scan(APP, found, np.array([0.0, 1, 0]), corrected=bool(part), keyframes=True)


def _kinds(folder: Path) -> list[str]:
    """Those ``PARTS`` of which a folder has cameras and images."""
    return [part for part in PARTS if all((folder / f"{part}{kind}").is_dir() for kind in ("cameras", "images"))]


def _numbered(folder: Path) -> dict[int, Path]:
    """Cameras by the times that they are called by."""
    return {int(file.stem): file for file in folder.glob("*.json") if file.stem.isdecimal()}


def _frame(keyframes: Path, part: str, number: int, file: Path) -> ScanFrame:
    told = read_object(file, REMEDY)
    try:
        rows = [[float(told[f"t_{row}{column}"]) for column in range(4)] for row in range(3)]
        fx, fy, cx, cy, width, height = (float(told[key]) for key in ("fx", "fy", "cx", "cy", "width", "height"))
        frame = ScanFrame(
            number,
            opengl_c2w_to_opencv_w2c(rows),
            (fx, fy, cx, cy),
            (int(width), int(height)),
            existing(keyframes / f"{part}images" / f"{file.stem}.jpg"),
            existing(keyframes / "depth" / f"{file.stem}.png"),
            existing(keyframes / "confidence" / f"{file.stem}.png"),
        )
        frame.camera(*frame.size or (1, 1))
    except KeyError as error:
        raise DataError(file, f"lacks {error}", REMEDY) from None
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(file, f"is no camera ({error})", REMEDY) from None
    return frame
