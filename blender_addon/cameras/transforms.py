"""Cameras of ``transforms.json`` (instant-ngp, nerfstudio, NeRF synthetic)."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..files.errors import FileError
from .camera import OPENCV_FROM_OPENGL, Camera, camera_name, require_pixels, rigid
from .json_object import KINDS, read_json_object

EXTENSIONS = ("", ".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", ".webp")
LENSES = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV")
FISHEYES = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")  # bend rays even without DISTORTIONS
OTHER_LENSES = ("ftheta_p0", "latlong", "equirectangular")  # of instant-ngp, each told by a key of its own
DISTORTIONS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
LISTED = "distortion_params"  # nerfstudio's, a list of such
MITSUBA = "normal_mts_args"  # by it instant-ngp knows Mitsuba's axes: x left, y up, z forward
OPENGL_FROM_MITSUBA = np.diag([-1.0, 1.0, -1.0, 1.0])
ANGLES = {"camera_angle_x", "camera_angle_y"}
OPTICS = {"fl_x", "fl_y"} | ANGLES
NAME = "view_name"  # the package's: of a frame that is named otherwise than by its file, as where this lies elsewhere


def read_transforms(path: Path, size_of: Callable[[Path], tuple[int, int]]) -> list[Camera]:
    """Cameras of one file; ``size_of`` tells the size of an image that the file does not say. Raises ``FileError``."""
    content = read_json_object(path)
    frames = content.get("frames")
    if not isinstance(frames, list) or not frames:
        raise FileError(path, 'has no cameras ("frames" is absent or empty)', KINDS)
    cameras = []
    for i, frame in enumerate(frames):
        if not isinstance(frame, dict) or not {"file_path", "transform_matrix"} <= frame.keys():
            problem = 'frame {number} lacks "file_path" or "transform_matrix"'
            raise FileError(path, problem, "add both to each frame", number=i)
        try:
            cameras.append(_transforms_camera(path, _merged(content, frame), size_of))
        except (TypeError, ValueError, ZeroDivisionError) as error:
            if isinstance(error, FileError):
                raise
            raise FileError(path, "frame {number}: {reason}", "correct its numbers", number=i, reason=error) from error
    return cameras


def _merged(content: dict[str, Any], frame: dict[str, Any]) -> dict[str, Any]:
    """What a frame says, and where it says nothing what stands at the top; focal lengths as the package has them."""
    of_frame, of_all = (OPTICS & part.keys() for part in (frame, content))
    same_side = {key[-1] for key in of_frame} & {key[-1] for key in of_all}
    alone = bool(of_frame) and (bool(same_side) or of_frame <= ANGLES)
    return {key: value for key, value in content.items() if not alone or key not in OPTICS} | frame


def _transforms_camera(path: Path, frame: dict[str, Any], size_of: Callable[[Path], tuple[int, int]]) -> Camera:
    name = str(frame["file_path"])
    lens = next((key for key in OTHER_LENSES if frame.get(key, False) is not False), None)
    lens = lens or frame.get("camera_model", "PINHOLE")
    if lens not in LENSES + FISHEYES:
        problem, known = '"{name}" has the lens {lens}, which is none of {known}', ", ".join(LENSES + FISHEYES)
        raise FileError(path, problem, "undistort the images first", name=name, lens=lens, known=known)
    fisheye = bool(frame.get("is_fisheye")) or lens in FISHEYES
    bent = fisheye or any(map(float, (*(frame.get(key, 0) for key in DISTORTIONS), *frame.get(LISTED, ()))))
    image = path.parent / name.replace("\\", "/")
    image = next((f for e in EXTENSIONS if (f := image.with_name(image.name + e)).is_file()), image)
    width, height = (int(frame["w"]), int(frame["h"])) if "w" in frame and "h" in frame else size_of(image)
    focal = [
        float(frame[pixels]) if pixels in frame
        else 0.5 * size / math.tan(0.5 * float(frame[angle])) if angle in frame else None
        for pixels, angle, size in (("fl_x", "camera_angle_x", width), ("fl_y", "camera_angle_y", height))
    ]  # fmt: skip
    fx, fy = focal[0] or focal[1], focal[1] or focal[0]
    if not fx or not fy or min(fx, fy) <= 0 or min(width, height) < 1:
        remedy = 'add "fl_x", "fl_y", "w", "h" in pixels'
        raise FileError(path, '"{name}" has no focal length or no size', remedy, name=name)
    cx, cy = float(frame.get("cx", width / 2)), float(frame.get("cy", height / 2))
    require_pixels(cx, cy, width, height)
    w2c = OPENCV_FROM_OPENGL @ np.linalg.inv(rigid(path, name, frame["transform_matrix"]))
    if MITSUBA in frame:  # half a turn about y
        w2c = OPENGL_FROM_MITSUBA @ w2c
    called = camera_name(str(frame.get(NAME, name)))
    photograph = image if image.is_file() else None
    return Camera(called, w2c, fx, fy, cx, cy, width, height, photograph, bent=bent)
