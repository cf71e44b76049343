"""COLMAP's binary model files: ``cameras.bin``, ``images.bin``, ``points3D.bin`` and ``frames.bin``.

Each raises ``DataError``.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from ..support.errors import DataError
from ..support.wording import count, counted
from .colmap_records import (
    MODELS,
    OTHER_MODELS,
    REMEDY,
    ColmapCamera,
    ColmapImage,
    ColmapPoints,
    camera_of,
    points_of,
    pose_of,
    unknown_model,
)

OBSERVATION = np.dtype([("xy", "<f8", 2), ("point", "<i8")])
DATA_ID = np.dtype([("kind", "<i4"), ("sensor", "<u4"), ("data", "<u8")])
CAMERA = 0  # the kind of sensor whose data are images


class Bytes:
    """A binary file that is read from front to back; running over its end is a ``DataError``, not a crash."""

    def __init__(self, path: Path):
        self.path, self.data, self.at = path, path.read_bytes(), 0

    def advance(self, size: int) -> int:
        """Step over ``size`` bytes and return where they began."""
        start, self.at = self.at, self.at + size
        if self.at > len(self.data):
            problem = f"ends early: {counted(len(self.data), 'byte')}, at least {count(self.at)} expected"
            raise DataError(self.path, problem, REMEDY)
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
            problem = f"{counted(len(self.data) - self.at, 'byte')} too many after the last entry"
            raise DataError(self.path, problem, REMEDY)


def cameras(path: Path) -> dict[int, ColmapCamera]:
    """By id."""
    file, found = Bytes(path), {}
    for _ in range(file.take("<Q")[0]):
        camera_id, model, width, height = file.take("<iiQQ")
        if model not in MODELS:
            raise unknown_model(path, camera_id, OTHER_MODELS.get(model, f"number {model}"))
        values = file.take(f"<{MODELS[model][1]}d")
        found[camera_id] = camera_of(path, camera_id, model, width, height, values)
    file.finish()
    return found


def images(path: Path) -> list[ColmapImage]:
    """In file order."""
    file, found = Bytes(path), []
    for _ in range(file.take("<Q")[0]):
        image_id, *pose, camera_id = file.take("<I7dI")
        name = file.text()
        rows = file.rows(OBSERVATION, file.take("<Q")[0])
        found.append(ColmapImage(image_id, name, camera_id, pose_of(path, name, pose), rows["xy"], rows["point"]))
    file.finish()
    return found


def points(path: Path) -> ColmapPoints:
    """Ordered by id."""
    file, ids, positions, colors = Bytes(path), [], [], []
    for _ in range(file.take("<Q")[0]):
        point_id, x, y, z, r, g, b, _, track_length = file.take("<Q3d3BdQ")
        file.advance(8 * track_length)  # the images say the same: which view sees which point
        ids.append(point_id)
        positions.append((x, y, z))
        colors.append((r, g, b))
    file.finish()
    return points_of(path, ids, positions, colors)


def frames(path: Path) -> dict[int, int]:
    """The id of the frame of each image, by its id."""
    file, found = Bytes(path), {}
    for _ in range(file.take("<Q")[0]):
        frame_id, *_, n_data = file.take("<II7dI")
        rows = file.rows(DATA_ID, n_data)
        found |= dict.fromkeys(rows["data"][rows["kind"] == CAMERA].tolist(), frame_id)
    file.finish()
    return found
