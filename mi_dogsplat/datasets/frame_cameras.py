"""The camera and the lens of a frame of ``transforms.json``, as instant-ngp and nerfstudio write them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.cameras import Camera, opengl_c2w_to_opencv_w2c, require_pixels
from ..support.errors import DataError
from ..support.json_values import in_json, number_in
from .images import image_size
from .lens import Lens

LENSES = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
FULL = "FULL_OPENCV"
FISHEYES = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
OTHER_LENSES = ("ftheta_p0", "latlong", "equirectangular")  # of instant-ngp, each told by a key of its own
UNDISTORT = "undistort the images first (for instance with COLMAP's image_undistorter)"
MITSUBA = "normal_mts_args"  # by it instant-ngp knows the axes of Mitsuba's cameras
OPENGL_FROM_MITSUBA = np.diag([-1.0, 1.0, -1.0, 1.0])
LISTED, IN_LIST = "distortion_params", ("k1", "k2", "k3", "k4", "p1", "p2")  # nerfstudio's, in one list
ANGLES = {"camera_angle_x", "camera_angle_y"}
OPTICS = {"fl_x", "fl_y"} | ANGLES
INTRINSICS = {"w": "width", "h": "height", "fl_x": "fx", "fl_y": "fy", "cx": "cx", "cy": "cy"}


def intrinsics_of(camera: Camera) -> dict[str, float]:
    """Those of a camera by the names that they have in these files."""
    return {key: getattr(camera, name) for key, name in INTRINSICS.items()}


def merged(shared: dict[str, Any], frame: dict[str, Any]) -> dict[str, Any]:
    """What a frame says, and where it says nothing what stands at the top.

    Focal lengths at the top, or angles, are not those of a frame that says another one, not along the other side
    either: as in instant-ngp, one alone means square pixels.
    """
    of_frame, of_all = (OPTICS & part.keys() for part in (frame, shared))
    same_side = {key[-1] for key in of_frame} & {key[-1] for key in of_all}
    if of_frame and (same_side or of_frame <= ANGLES):
        shared = {key: value for key, value in shared.items() if key not in OPTICS}
    return {**shared, **frame}


def pose_of(frame: dict[str, Any]) -> np.ndarray:
    """World to camera [4, 4], in OpenCV's axes, of a frame (top-level values already merged in). Raises ``ValueError``
    or ``TypeError``."""
    w2c = opengl_c2w_to_opencv_w2c(frame["transform_matrix"])
    return OPENGL_FROM_MITSUBA @ w2c if MITSUBA in frame else w2c  # half a turn about y


def camera_of(file: Path, frame: dict[str, Any], w2c: np.ndarray, image_path: Path) -> Camera:
    """Camera of a frame, ``w2c`` its ``pose_of``. Raises ``DataError`` or ``ValueError``."""
    stated = "w" in frame and "h" in frame
    width, height = (int(number_in(frame, "w")), int(number_in(frame, "h"))) if stated else image_size(image_path)
    fx = _focal(frame, "fl_x", "camera_angle_x", width)
    fy = _focal(frame, "fl_y", "camera_angle_y", height)
    if fx is None and fy is None:
        raise DataError(file, "has no focal length", 'add "fl_x" and "fl_y" in pixels, or "camera_angle_x" in radians')
    fx, fy = (fy if fx is None else fx), (fx if fy is None else fy)  # one focal length means square pixels
    assert fx is not None and fy is not None
    cx, cy = number_in(frame, "cx", width / 2), number_in(frame, "cy", height / 2)
    require_pixels(cx, cy, width, height)
    return Camera(w2c, fx, fy, cx, cy, width, height)


def lens_of(file: Path, frame: dict[str, Any]) -> Lens:
    """Distortion of a frame: polynomials with k1 to k4, as instant-ngp and nerfstudio have them, or FULL_OPENCV's.

    Raises ``DataError`` or ``ValueError``.
    """
    if LISTED in frame:
        if not isinstance(listed := frame[LISTED], list) or len(listed) != len(IN_LIST):
            raise ValueError(f'"{LISTED}" is {in_json(listed)}, no list of {", ".join(IN_LIST)}')
        frame = {**frame, **dict(zip(IN_LIST, listed, strict=True))}
    model = next((key for key in OTHER_LENSES if frame.get(key, False) is not False), None)
    model = model or frame.get("camera_model", "PINHOLE")
    if not isinstance(model, str):
        raise ValueError(f'"camera_model" is {in_json(model)}, no name of a lens')
    fisheye = bool(frame.get("is_fisheye")) or model in FISHEYES
    k, p = ([number_in(frame, f"{letter}{i}", 0) for i in range(1, n)] for letter, n in (("k", 7), ("p", 3)))
    if model == FULL and not fisheye:
        return Lens(tuple(k[:3]), (p[0], p[1]), divisor=tuple(k[3:]))
    known = model in LENSES + FISHEYES
    if not known or any(k[4:]) or (fisheye and any(p)):
        named = ", ".join((*LENSES, FULL, *FISHEYES))
        problem = f'"{frame["file_path"]}" has a lens {model} with k1 to k6 {k} and p1, p2 {p}'
        known_ones = f"known are {named} with k1 to k4, {FULL} to k6, and p1, p2 where it is no fisheye"
        raise DataError(file, f"{problem} ({known_ones})", UNDISTORT)
    return Lens(tuple(k[:4]), (p[0], p[1]), fisheye)


def _focal(frame: dict[str, Any], pixels_key: str, angle_key: str, size: int) -> float | None:
    if pixels_key in frame:
        return number_in(frame, pixels_key)
    if angle_key in frame:
        angle = number_in(frame, angle_key)
        if not 0 < angle < math.pi:
            raise ValueError(f'"{angle_key}" is {angle:g}, no angle of view in radians')
        return 0.5 * size / math.tan(0.5 * angle)
    return None
