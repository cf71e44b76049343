"""COLMAP's model files as text: ``cameras.txt``, ``images.txt``, ``points3D.txt`` and ``frames.txt``.

Each raises ``DataError``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..support.errors import DataError
from .colmap_records import (
    MAX_ID,
    MODELS,
    REMEDY,
    ColmapCamera,
    ColmapImage,
    ColmapPoints,
    camera_of,
    points_of,
    pose_of,
    unknown_model,
)


def cameras(path: Path) -> dict[int, ColmapCamera]:
    """By id."""
    found = {}
    models = {name: model for model, (name, _, _) in MODELS.items()}
    for number, line in _lines(path):
        try:
            camera_id, name, width, height, *values = line.split()
            if name not in models:
                raise unknown_model(path, int(camera_id), name)
            parsed = int(camera_id), models[name], int(width), int(height), tuple(float(v) for v in values)
        except DataError:
            raise
        except ValueError as error:
            raise _bad_line(path, number, error) from error
        found[parsed[0]] = camera_of(path, *parsed)
    return found


def images(path: Path) -> list[ColmapImage]:
    """In file order."""
    found = []
    lines = iter(_lines(path, keep_empty=True))  # an image without observations has an empty second line
    for number, line in lines:
        if not line:
            continue
        try:
            image_id, *pose, camera_id, name = line.split(maxsplit=9)
            w2c = pose_of(path, name, [float(v) for v in pose])
            ids = int(image_id), int(camera_id)
            number, line = next(lines, (number + 1, ""))
            if _is_image(line):
                problem = f'line {number} is of an image, and not of the points that "{name}" sees'
                raise DataError(path, problem, "put an empty line after that of each image")
            rows = np.array(line.split(), np.float64).reshape(-1, 3)  # [M, 3] x, y, point id
            if not (np.abs(rows[:, 2]) < MAX_ID).all():  # NaN is not
                raise ValueError("the id of a point is not a whole number")
        except DataError:
            raise
        except ValueError as error:
            raise _bad_line(path, number, error) from error
        found.append(ColmapImage(ids[0], name, ids[1], w2c, rows[:, :2], rows[:, 2].astype(np.int64)))
    return found


def _is_image(line: str) -> bool:
    """Whether a line is like those of images: nine numbers and a name that is none."""
    words = line.split(maxsplit=9)
    return len(words) == 10 and _is_number(words[8]) and not _is_number(words[9].split()[0])


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def points(path: Path) -> ColmapPoints:
    """Ordered by id."""
    ids, positions, colors = [], [], []
    for number, line in _lines(path):
        try:
            point_id, x, y, z, r, g, b = line.split()[:7]
            ids.append(int(point_id))
            positions.append((float(x), float(y), float(z)))
            colors.append(tuple(bytes((int(r), int(g), int(b)))))  # 0 to 255, or ValueError
        except ValueError as error:
            raise _bad_line(path, number, error) from error
    return points_of(path, ids, positions, colors)


def frames(path: Path) -> dict[int, int]:
    """The id of the frame of each image, by its id."""
    found = {}
    for number, line in _lines(path):
        try:
            words = line.split()
            frame_id, n_data, data = int(words[0]), int(words[9]), words[10:]
            kinds, ids = data[::3], [int(word) for word in data[2::3]]
            if len(data) != 3 * n_data:
                raise ValueError(f"{len(data)} words for {n_data} data ids of 3")
        except (IndexError, ValueError) as error:
            raise _bad_line(path, number, error) from error
        found |= {image_id: frame_id for kind, image_id in zip(kinds, ids, strict=True) if kind == "CAMERA"}
    return found


def _lines(path: Path, keep_empty: bool = False) -> list[tuple[int, str]]:
    """(line number from 1, text) of all lines that are no comment."""
    lines = enumerate(path.read_text(encoding="utf-8-sig", errors="replace").splitlines(), 1)
    return [(n, line.strip()) for n, line in lines if (line.strip() or keep_empty) and not line.startswith("#")]


def _bad_line(path: Path, number: int, error: Exception) -> DataError:
    return DataError(path, f"line {number} cannot be read ({error})", REMEDY)
