"""Reader of COLMAP's model files (cameras, images, points3D; binary and text).

A parser of our own instead of pycolmap 4.2.1, for two measured reasons. It weighs little to write, and
pycolmap weighs 36 MiB as a wheel and 135 MiB installed (0.4 s to import). And pycolmap trusts its input: a
truncated ``cameras.bin`` loads without a word with repeated bytes as intrinsics, a truncated ``points3D.bin``
was still busy after 60 s behind a C++ stack trace. Here every read is checked against the size of the file.
pycolmap is the oracle of the tests.

Format: COLMAP's documentation, "Output Format". Poses are read from ``images``, which COLMAP keeps writing
beside the newer ``rigs`` and ``frames``.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.cameras import RIGID_TOLERANCE
from ..support.errors import DataError
from .lens import Lens

# id: (name, number of parameters, fx and fy apart)
MODELS = {
    0: ("SIMPLE_PINHOLE", 3, False),
    1: ("PINHOLE", 4, True),
    2: ("SIMPLE_RADIAL", 4, False),
    3: ("RADIAL", 5, False),
    4: ("OPENCV", 8, True),
    5: ("OPENCV_FISHEYE", 8, True),
    6: ("FULL_OPENCV", 12, True),  # with coefficients of zero only
    8: ("SIMPLE_RADIAL_FISHEYE", 4, False),
    9: ("RADIAL_FISHEYE", 5, False),
}
MAX_SIDE = 2**20  # pixels of an image
MAX_ID = 2**53  # of a point: beyond, a text file's would be rounded
REMEDY = "copy the file again or export the model again"
UNDISTORT = "run COLMAP's image_undistorter and use the folder that it writes"


@dataclass(frozen=True)
class ColmapCamera:
    """Intrinsics in pixels; COLMAP too puts the centre of the first pixel at (0.5, 0.5)."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    lens: Lens


@dataclass(frozen=True, eq=False)
class ColmapImage:
    """Pose (OpenCV world-to-camera [4, 4]) and observed pixels [M, 2] with the ids [M] of their points (-1:
    none)."""

    name: str
    camera_id: int
    w2c: np.ndarray
    pixels: np.ndarray
    point_ids: np.ndarray


@dataclass(frozen=True, eq=False)
class ColmapPoints:
    """Sparse points: ``ids`` [P], ``positions`` [P, 3] float32, ``colors`` [P, 3] float32 in 0..1."""

    ids: np.ndarray
    positions: np.ndarray
    colors: np.ndarray


class Bytes:
    """A binary file that is read from front to back; running over its end is a ``DataError``, not a crash."""

    def __init__(self, path: Path):
        self.path, self.data, self.at = path, path.read_bytes(), 0

    def advance(self, size: int) -> int:
        """Step over ``size`` bytes and return where they began."""
        start, self.at = self.at, self.at + size
        if self.at > len(self.data):
            raise DataError(
                self.path, f"ends early: {len(self.data)} bytes, at least {self.at} expected", REMEDY
            )
        return start

    def take(self, layout: str) -> tuple[Any, ...]:
        return struct.unpack_from(layout, self.data, self.advance(struct.calcsize(layout)))

    def rows(self, dtype: np.dtype, count: int) -> np.ndarray:
        return np.frombuffer(self.data, dtype, count, self.advance(dtype.itemsize * count))

    def text(self) -> str:
        """A string that ends in a zero byte."""
        end = self.data.find(b"\0", self.at)
        start = self.advance((end if end >= 0 else len(self.data)) + 1 - self.at)
        return self.data[start:end].decode(errors="replace")

    def finish(self) -> None:
        if self.at != len(self.data):
            raise DataError(
                self.path, f"{len(self.data) - self.at} bytes too many after the last entry", REMEDY
            )


OBSERVATION = np.dtype([("xy", "<f8", 2), ("point", "<i8")])


def read_cameras(path: Path) -> dict[int, ColmapCamera]:
    """Cameras by id from ``cameras.bin`` or ``cameras.txt``. Raises ``DataError``, also for a lens that is
    not known here."""
    cameras = {}
    if path.suffix == ".bin":
        file = Bytes(path)
        for _ in range(file.take("<Q")[0]):
            camera_id, model, width, height = file.take("<iiQQ")
            if model not in MODELS:
                raise _unknown_model(path, camera_id, f"number {model}")
            values = file.take(f"<{MODELS[model][1]}d")
            cameras[camera_id] = _camera(path, camera_id, model, width, height, values)
        file.finish()
        return cameras
    numbers = {name: number for number, (name, _, _) in MODELS.items()}
    for number, line in _lines(path):
        try:
            camera_id, name, width, height, *values = line.split()
            if name not in numbers:
                raise _unknown_model(path, int(camera_id), name)
            parsed = int(camera_id), numbers[name], int(width), int(height), tuple(float(v) for v in values)
        except DataError:
            raise
        except ValueError as error:
            raise _bad_line(path, number, error) from error
        cameras[parsed[0]] = _camera(path, *parsed)
    return cameras


def read_images(path: Path) -> list[ColmapImage]:
    """Registered images from ``images.bin`` or ``images.txt``, in file order. Raises ``DataError``."""
    images = []
    if path.suffix == ".bin":
        file = Bytes(path)
        for _ in range(file.take("<Q")[0]):
            _, *pose, camera_id = file.take("<I7dI")
            name = file.text()
            rows = file.rows(OBSERVATION, file.take("<Q")[0])
            images.append(ColmapImage(name, camera_id, _pose(path, name, pose), rows["xy"], rows["point"]))
        file.finish()
        return images
    lines = iter(_lines(path, keep_empty=True))  # an image without observations has an empty second line
    for number, line in lines:
        if not line:
            continue
        try:
            _, *pose, camera_id, name = line.split(maxsplit=9)
            w2c = _pose(path, name, [float(v) for v in pose])
            camera = int(camera_id)
            number, line = next(lines, (number + 1, ""))
            rows = np.array(line.split(), np.float64).reshape(-1, 3)  # [M, 3] x, y, point id
            if not (np.abs(rows[:, 2]) < MAX_ID).all():  # NaN is not
                raise ValueError("the id of a point is no whole number")
        except DataError:
            raise
        except ValueError as error:
            raise _bad_line(path, number, error) from error
        images.append(ColmapImage(name, camera, w2c, rows[:, :2], rows[:, 2].astype(np.int64)))
    return images


def read_points(path: Path) -> ColmapPoints:
    """Sparse points from ``points3D.bin`` or ``points3D.txt``, ordered by id. Raises ``DataError``."""
    ids, positions, colors = [], [], []
    if path.suffix == ".bin":
        file = Bytes(path)
        for _ in range(file.take("<Q")[0]):
            point_id, x, y, z, r, g, b, _, track_length = file.take("<Q3d3BdQ")
            file.advance(8 * track_length)  # the images say the same: which view sees which point
            ids.append(point_id)
            positions.append((x, y, z))
            colors.append((r, g, b))
        file.finish()
    else:
        for number, line in _lines(path):
            try:
                point_id, x, y, z, r, g, b = line.split()[:7]
                ids.append(int(point_id))
                positions.append((float(x), float(y), float(z)))
                colors.append(tuple(bytes((int(r), int(g), int(b)))))  # 0 to 255, or ValueError
            except ValueError as error:
                raise _bad_line(path, number, error) from error
    if not all(0 <= point_id < MAX_ID for point_id in ids):
        raise DataError(path, "the id of a point is no number that COLMAP gives", REMEDY)
    order = np.argsort(np.array(ids, np.int64))
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite: see below
        points = np.array(positions, np.float32).reshape(-1, 3)[order]
    if not np.isfinite(points).all():
        raise DataError(path, "a point is not finite", REMEDY)
    rgb = np.array(colors, np.float32).reshape(-1, 3)[order] / 255
    return ColmapPoints(np.array(ids, np.int64)[order], points, rgb)


def _camera(
    path: Path, camera_id: int, model: int, width: int, height: int, values: tuple[float, ...]
) -> ColmapCamera:
    name, n_values, separate = MODELS[model]
    if len(values) != n_values:
        raise DataError(
            path, f"camera {camera_id} has {len(values)} parameters, {name} has {n_values}", REMEDY
        )
    if (
        not np.isfinite(values).all()
        or min(values[: 1 + separate]) <= 0
        or not 0 < min(width, height) <= max(width, height) < MAX_SIDE
    ):
        raise DataError(path, f"camera {camera_id} is {width}x{height} with parameters {values}", REMEDY)
    focal, (cx, cy, *distortion) = values[: 1 + separate], values[1 + separate :]
    if name == "FULL_OPENCV":
        if any(distortion):
            raise _unknown_model(path, camera_id, f"{name} with {distortion}")
        distortion = []
    lens = Lens(tuple(distortion[:2]), (distortion[2], distortion[3])) if name == "OPENCV" else Lens(tuple(distortion))
    if name.endswith("FISHEYE"):
        lens = Lens(tuple(distortion), fisheye=True)
    return ColmapCamera(focal[0], focal[-1], cx, cy, width, height, lens)


def _unknown_model(path: Path, camera_id: int, model: str) -> DataError:
    known = ", ".join(name for name, _, _ in MODELS.values() if name != "FULL_OPENCV")
    return DataError(path, f"camera {camera_id} has the model {model}, which is none of {known}", UNDISTORT)


def _pose(path: Path, name: str, pose: list[float]) -> np.ndarray:
    """World-to-camera [4, 4] from quaternion w, x, y, z and translation."""
    if len(pose) != 7:
        raise ValueError(f"a pose has 7 numbers, got {len(pose)}")
    with np.errstate(over="ignore", invalid="ignore"):
        norm = float(np.linalg.norm(pose[:4]))
    if not np.isfinite(pose).all() or abs(norm - 1) > RIGID_TOLERANCE:
        raise DataError(path, f'image "{name}" has no valid pose (quaternion {pose[:4]})', REMEDY)
    w, x, y, z = np.array(pose[:4]) / norm
    w2c = np.eye(4)
    w2c[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    w2c[:3, 3] = pose[4:]
    return w2c


def _lines(path: Path, keep_empty: bool = False) -> list[tuple[int, str]]:
    """(line number from 1, text) of all lines that are no comment."""
    lines = enumerate(path.read_text(encoding="utf-8-sig", errors="replace").splitlines(), 1)
    return [
        (n, line.strip()) for n, line in lines if (line.strip() or keep_empty) and not line.startswith("#")
    ]


def _bad_line(path: Path, number: int, error: Exception) -> DataError:
    return DataError(path, f"line {number} cannot be read ({error})", REMEDY)
