"""What COLMAP's model files hold, and what of it can be used: the same for binary and text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..scene.cameras import RIGID_TOLERANCE, affine, require_pixels
from ..scene.quaternions import rotation_from_quaternion
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
    6: ("FULL_OPENCV", 12, True),
    8: ("SIMPLE_RADIAL_FISHEYE", 4, False),
    9: ("RADIAL_FISHEYE", 5, False),
    14: ("SIMPLE_FISHEYE", 3, False),
    15: ("FISHEYE", 4, True),
}
OTHER_MODELS = {
    7: "FOV", 10: "THIN_PRISM_FISHEYE", 11: "RAD_TAN_THIN_PRISM_FISHEYE", 12: "SIMPLE_DIVISION", 13: "DIVISION",
    16: "EUCM", 17: "EQUIRECTANGULAR",
}  # fmt: skip
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
    """Pose (OpenCV world-to-camera [4, 4]) and observed pixels [M, 2] with the ids [M] of their points (-1: none)."""

    image_id: int
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


def camera_of(
    path: Path, camera_id: int, model: int, width: int, height: int, values: tuple[float, ...]
) -> ColmapCamera:
    """``model`` is a number in ``MODELS``, ``values`` its parameters. Raises ``DataError``."""
    name, n_values, separate = MODELS[model]
    if len(values) != n_values:
        raise DataError(path, f"camera {camera_id} has {len(values)} parameters, {name} has {n_values}", REMEDY)
    if (
        not np.isfinite(values).all()
        or min(values[: 1 + separate]) <= 0
        or not 0 < min(width, height) <= max(width, height) < MAX_SIDE
    ):
        raise DataError(path, f"camera {camera_id} is {width}x{height} with parameters {values}", REMEDY)
    focal, (cx, cy, *distortion) = values[: 1 + separate], values[1 + separate :]
    try:
        require_pixels(cx, cy, width, height)
    except ValueError as error:
        raise DataError(path, f"camera {camera_id}: {error}", "multiply them by width and height") from None
    lens = Lens(tuple(distortion), fisheye=name.endswith("FISHEYE"))
    if name in ("OPENCV", "FULL_OPENCV"):
        k1, k2, p1, p2, *others = distortion
        lens = Lens((k1, k2, *others[:1]), (p1, p2), divisor=tuple(others[1:]))
    return ColmapCamera(focal[0], focal[-1], cx, cy, width, height, lens)


def unknown_model(path: Path, camera_id: int, model: str) -> DataError:
    """The error for a camera whose lens is not known here; ``model`` is its name or number, in words."""
    known = ", ".join(name for name, _, _ in MODELS.values())
    return DataError(path, f"camera {camera_id} has the model {model}, which is none of {known}", UNDISTORT)


def pose_of(path: Path, name: str, pose: list[float]) -> np.ndarray:
    """World-to-camera [4, 4] from quaternion w, x, y, z and translation.

    Raises ``ValueError`` for another number of numbers, ``DataError`` for what is no pose.
    """
    if len(pose) != 7:
        raise ValueError(f"a pose has 7 numbers, got {len(pose)}")
    with np.errstate(over="ignore", invalid="ignore"):
        norm = float(np.linalg.norm(pose[:4]))
    if not np.isfinite(pose).all() or abs(norm - 1) > RIGID_TOLERANCE:
        raise DataError(path, f'image "{name}" has no valid pose (quaternion {pose[:4]})', REMEDY)
    w, *vector = pose[:4]
    return affine(rotation_from_quaternion(np.array([[*vector, w]]))[0], pose[4:])


def points_of(path: Path, ids: Sequence[int], positions: Sequence[tuple], colors: Sequence[tuple]) -> ColmapPoints:
    """Points of a file in the order of their ids; colours are 0 to 255. Raises ``DataError``."""
    if not all(0 <= point_id < MAX_ID for point_id in ids):
        raise DataError(path, "the id of a point is not a number that COLMAP would give", REMEDY)
    order = np.argsort(np.array(ids, np.int64))
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite: see below
        points = np.array(positions, np.float32).reshape(-1, 3)[order]
    if not np.isfinite(points).all():
        raise DataError(path, "a point is not finite", REMEDY)
    rgb = np.array(colors, np.float32).reshape(-1, 3)[order] / 255
    return ColmapPoints(np.array(ids, np.int64)[order], points, rgb)
