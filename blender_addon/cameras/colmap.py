"""Cameras of a COLMAP model (binary and text). Format: COLMAP's documentation, "Output Format"."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from ..files.errors import FileError, told
from ..files.rotation import rotations
from .camera import Camera, camera_name, require_pixels, rigid

MODEL_FOLDERS = ("sparse/0", "sparse", "colmap/sparse/0", ".")
# Number in binary files, name, number of parameters. A fisheye bends rays even with zero coefficients.
LENSES = {
    0: ("SIMPLE_PINHOLE", 3), 1: ("PINHOLE", 4), 2: ("SIMPLE_RADIAL", 4), 3: ("RADIAL", 5), 4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8), 6: ("FULL_OPENCV", 12), 8: ("SIMPLE_RADIAL_FISHEYE", 4), 9: ("RADIAL_FISHEYE", 5),
    14: ("SIMPLE_FISHEYE", 3), 15: ("FISHEYE", 4),
}  # fmt: skip
NUMBERS = {name: number for number, (name, _) in LENSES.items()}
SEPARATE = ("PINHOLE", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FISHEYE")  # fx and fy apart
DAMAGED = "copy the file again or export the model again"
UNKNOWN = "camera {number} has the model {model}, which is none of {known}"
UNDISTORT = "run COLMAP's image_undistorter and use the folder that it writes"
Intrinsics = dict[str, Any]  # of a ``Camera``, by name


def find_model(path: Path) -> Path | None:
    """The first folder below ``path`` that holds cameras and images of a COLMAP model, or None."""
    return next((path / f for f in MODEL_FOLDERS if _file(path / f, "cameras") and _file(path / f, "images")), None)


def read_colmap(path: Path, model: Path) -> list[Camera]:
    """Cameras of a model folder in the data set ``path``. Raises ``FileError``."""
    camera_file, image_file = _file(model, "cameras"), _file(model, "images")
    assert camera_file and image_file
    read_cameras, read_images = (
        (binary if file.suffix == ".bin" else text)
        for file, binary, text in ((camera_file, _binary_cameras, _text_cameras),
                                   (image_file, _binary_images, _text_images))
    )  # fmt: skip
    try:
        intrinsics = read_cameras(camera_file)
    except (struct.error, ValueError) as error:
        raise _explained(camera_file, error) from error
    try:
        poses = read_images(image_file)
    except (struct.error, ValueError) as error:
        raise _explained(image_file, error) from error
    if not poses:
        raise FileError(image_file, "the model has no registered image", "run COLMAP's mapper until images register")
    folder = next((f / "images" for f in (path, *path.resolve().parents[:2]) if (f / "images").is_dir()), None)
    cameras = []
    for name, camera_id, pose in poses:
        if camera_id not in intrinsics:
            problem = 'image "{name}" uses camera {number}, which is not there'
            raise FileError(image_file, problem, DAMAGED, name=name, number=camera_id)
        image = folder / name if folder and (folder / name).is_file() else None
        w2c = rigid(image_file, name, _matrix(pose))
        cameras.append(Camera(camera_name(name), w2c, image=image, **intrinsics[camera_id]))
    return cameras


def _explained(path: Path, error: Exception) -> FileError:
    if isinstance(error, FileError):
        return error
    return FileError(path, "cannot be read ({reason})", DAMAGED, reason=error)


def _file(model: Path, stem: str) -> Path | None:
    return next((file for suffix in (".bin", ".txt") if (file := model / (stem + suffix)).is_file()), None)


def _intrinsics(path: Path, camera_id: int, model: str, width: int, height: int, values: list[float]) -> Intrinsics:
    separate = model in SEPARATE
    fx, fy = (values[0], values[1]) if separate else (values[0], values[0])
    cx, cy, *distortion = values[2 if separate else 1 :]
    if not (np.isfinite(values).all() and min(fx, fy) > 0 and min(width, height) > 0):
        size, problem = f"{width}x{height}", "camera {number} is {size} with parameters {values}"
        raise FileError(path, problem, DAMAGED, number=camera_id, size=size, values=values)
    try:
        require_pixels(cx, cy, width, height)
    except ValueError as error:
        problem, remedy = "camera {number}: {reason}", "multiply them by width and height"
        raise FileError(path, problem, remedy, number=camera_id, reason=error) from None
    bent = any(distortion) or model.endswith("FISHEYE")
    return {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "width": width, "height": height, "bent": bent}


def _binary_cameras(path: Path) -> dict[int, Intrinsics]:
    data, at, cameras = path.read_bytes(), 8, {}
    for _ in range(struct.unpack_from("<Q", data)[0]):
        camera_id, number, width, height = struct.unpack_from("<iiQQ", data, at)
        if number not in LENSES:
            raise FileError(path, UNKNOWN, UNDISTORT, number=camera_id, model=number, known=", ".join(NUMBERS))
        model, count = LENSES[number]
        values = struct.unpack_from(f"<{count}d", data, at + 24)
        at += 24 + 8 * count
        cameras[camera_id] = _intrinsics(path, camera_id, model, width, height, list(values))
    return cameras


def _binary_images(path: Path) -> list[tuple[str, int, list[float]]]:
    data, at, images = path.read_bytes(), 8, []
    for _ in range(struct.unpack_from("<Q", data)[0]):
        _, *pose, camera_id = struct.unpack_from("<I7dI", data, at)
        end = data.index(b"\0", at + 64)
        images.append((data[at + 64 : end].decode(errors="replace"), camera_id, pose))
        at = end + 9 + 24 * struct.unpack_from("<Q", data, end + 1)[0]  # the observed points are not needed
    if at != len(data):
        raise ValueError(told("{size} bytes instead of {expected}", size=len(data), expected=at))
    return images


def _text_cameras(path: Path) -> dict[int, Intrinsics]:
    cameras = {}
    for line in _text_lines(path):
        if line.strip() and not line.startswith("#"):
            camera_id, model, width, height, *values = line.split()
            if model not in NUMBERS:
                raise FileError(path, UNKNOWN, UNDISTORT, number=camera_id, model=model, known=", ".join(NUMBERS))
            numbers = [float(value) for value in values]
            if len(numbers) != LENSES[NUMBERS[model]][1]:
                problem = "camera {number} has {count} parameters"
                raise FileError(path, problem, DAMAGED, number=camera_id, count=len(numbers))
            cameras[int(camera_id)] = _intrinsics(path, int(camera_id), model, int(width), int(height), numbers)
    return cameras


def _text_images(path: Path) -> list[tuple[str, int, list[float]]]:
    lines = iter([line.strip() for line in _text_lines(path) if not line.startswith("#")])
    images = []
    for line in lines:
        if line:
            _, *pose, camera_id, name = line.split(maxsplit=9)
            images.append((name, int(camera_id), [float(value) for value in pose]))
            next(lines, None)  # lists observed points, and may be empty
    return images


def _text_lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8-sig", errors="replace").splitlines()  # a mark may come first


def _matrix(pose: list[float]) -> np.ndarray:
    """World-to-camera [4, 4] from quaternion w, x, y, z and translation."""
    quaternion = np.array(pose[:4]) / np.linalg.norm(pose[:4])
    w2c = np.eye(4)
    w2c[:3, :3], w2c[:3, 3] = rotations(quaternion[None])[0], pose[4:]
    return w2c
