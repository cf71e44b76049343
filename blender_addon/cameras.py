"""Pinhole cameras of data sets as numbers: ``transforms.json``, COLMAP folders, and our run folders.

A pose is OpenCV's world-to-camera (x right, y down, z forward); Blender's own cameras look along -z with y up.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .errors import FileError

OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
EXTENSIONS = ("", ".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG", ".webp")
DISTORTIONS = ("k1", "k2", "k3", "k4", "p1", "p2")
RIGID_TOLERANCE = 1e-3
KINDS = "a folder with sparse/0, transforms.json or transforms_train.json, such a file, or a run folder"


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics in pixels (the centre of the first pixel is (0.5, 0.5)) and pose of an image."""

    name: str
    w2c: np.ndarray  # [4, 4]
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    image: Path | None = None

    def downscaled(self, k: int) -> Camera:
        """The camera of the image averaged over k x k pixels, the remainder cut off."""
        values = {name: getattr(self, name) / k for name in ("fx", "fy", "cx", "cy")}
        return replace(self, **values, width=max(self.width // k, 1), height=max(self.height // k, 1))


def read_cameras(path: str | Path, size_of: Callable[[Path], tuple[int, int]]) -> tuple[list[Camera], int]:
    """(cameras sorted by name, the downscaling that a run folder was trained with, else 1). Raises ``FileError``.

    ``size_of`` tells the size of an image file, for data sets that do not say it.
    """
    from .colmap import find_model, read_colmap

    path = Path(path)
    if not path.exists():
        raise FileError(path, "no such file or folder", "check the path")
    if path.name == "config.json" or (path.is_dir() and (path / "config.json").is_file()):
        config_file = path if path.is_file() else path / "config.json"
        config = _read_json(config_file)
        data = Path(str(config.get("data", "")))
        if "data" not in config or not data.exists():
            problem = f'its data set "{data}" is not there' if "data" in config else "does not name a data set"
            raise FileError(config_file, problem, "import the cameras from the data set itself")
        return read_cameras(data, size_of)[0], int(config.get("downscale", 1))
    if path.is_file() and path.suffix in (".bin", ".txt"):
        path = path.parent
    if path.is_dir() and (model := find_model(path)):
        cameras = read_colmap(path, model)
    else:
        names = ("transforms.json", "transforms_train.json", "transforms_test.json")
        files = [path] if path.is_file() else [path / name for name in names if (path / name).is_file()]
        if path.is_dir() and files and files[0].name == "transforms.json":
            files = files[:1]
        if not files:
            raise FileError(path, "no cameras found", f"give {KINDS}")
        cameras = [camera for file in files for camera in _read_transforms(file, size_of)]
    return sorted(cameras, key=lambda camera: camera.name), 1


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
        raise FileError(path, f'the pose of "{name}" cannot be used ({error})', "correct it") from error
    u, _, vt = np.linalg.svd(rotation)
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = u @ vt, given[:3, 3]
    return result


def camera_name(file: str) -> str:
    """Name of the view of an image file: no extension and no folder ``images``; ``/`` becomes ``_``."""
    parts = [part for part in Path(file.replace("\\", "/")).with_suffix("").parts if part not in (".", "..", "/")]
    return "_".join(parts[1:] if len(parts) > 1 and parts[0].split("_")[0] == "images" else parts)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise FileError(path, f"not valid JSON in line {error.lineno} ({error.msg})", "correct that line") from error
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(path, f"cannot be read ({error})", "give a text file in UTF-8") from error
    if not isinstance(content, dict):
        raise FileError(path, "is not a JSON object", f"give {KINDS}")
    return content


def _read_transforms(path: Path, size_of: Callable[[Path], tuple[int, int]]) -> list[Camera]:
    content = _read_json(path)
    frames = content.get("frames")
    if not isinstance(frames, list) or not frames:
        raise FileError(path, 'has no cameras ("frames" is absent or empty)', f"give {KINDS}")
    cameras = []
    for i, frame in enumerate(frames):
        if not isinstance(frame, dict) or not {"file_path", "transform_matrix"} <= frame.keys():
            raise FileError(path, f'frame {i} lacks "file_path" or "transform_matrix"', "add both to each frame")
        try:
            cameras.append(_transforms_camera(path, {**content, **frame}, size_of))
        except (TypeError, ValueError, ZeroDivisionError) as error:
            if isinstance(error, FileError):
                raise
            raise FileError(path, f"frame {i}: {error}", "correct its numbers") from error
    return cameras


def _transforms_camera(path: Path, frame: dict[str, Any], size_of: Callable[[Path], tuple[int, int]]) -> Camera:
    name = str(frame["file_path"])
    if frame.get("is_fisheye") or any(float(frame.get(key, 0)) for key in DISTORTIONS):
        raise FileError(path, f'"{name}" has lens distortion', "undistort the images first")
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
        raise FileError(path, f'"{name}" has no focal length or no size', 'add "fl_x", "fl_y", "w", "h" in pixels')
    cx, cy = float(frame.get("cx", width / 2)), float(frame.get("cy", height / 2))
    w2c = OPENCV_FROM_OPENGL @ np.linalg.inv(rigid(path, name, frame["transform_matrix"]))
    return Camera(camera_name(name), w2c, fx, fy, cx, cy, width, height, image if image.is_file() else None)
