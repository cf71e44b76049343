"""Scans by Stray Scanner: ``rgb.mp4``, ``depth/*.png`` in millimetres, ``confidence/*.png`` with 0 for low, 1 and 2.

``odometry.csv`` has a row for each frame of the video: its number, by which depth maps are called, the place of the
camera and its rotation, camera-to-world, OpenCV, in the world of ARKit, whose y is up; and since 2026 fx, fy, cx and
cy. Before that ``camera_matrix.csv`` has those of the last frame. All of them are of the pixels as the sensor has them;
some versions have the video turned upright when it is played. Source: docs/format.md and ``OdometryEncoder.swift`` of
github.com/strayrobots/scanner, and issue 17 there.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from ...scene.cameras import inverse_rigid
from ...support.errors import DataError
from .scan import REMEDY, Scan, ScanFrame, existing, pose_of, require_frames

APP = "Stray Scanner"
VIDEO, ODOMETRY, MATRIX = "rgb.mp4", "odometry.csv", "camera_matrix.csv"
POSE, FOCAL = ("x", "y", "z", "qx", "qy", "qz", "qw"), ("fx", "fy", "cx", "cy")


def find(path: Path) -> Path | None:
    """``path`` if it is the folder of such a scan, else None."""
    return path if (path / VIDEO).is_file() and (path / ODOMETRY).is_file() else None


def read(folder: Path) -> Scan:
    """The scan of a folder; its frames are numbered as in the video. Raises ``DataError``."""
    file, matrix = folder / ODOMETRY, folder / MATRIX
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    try:
        rows = list(csv.DictReader(lines, skipinitialspace=True))
    except csv.Error as error:
        raise DataError(file, f"is no table ({error})", REMEDY) from None
    columns = {name.strip() for name in rows[0] if name} if rows else set()
    if missing := [name for name in POSE if name not in columns]:
        raise DataError(file, f'has no column "{missing[0]}"', REMEDY)
    shared = None if set(FOCAL) <= columns else _matrix(matrix)
    frames = [_frame(folder, file, number, row, shared) for number, row in enumerate(rows)]
    require_frames(folder, frames)
    return Scan(APP, frames, np.array([0.0, 1, 0]), video=folder / VIDEO)


def _matrix(file: Path) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy of a 3x3 matrix in a file."""
    try:
        rows = [[float(word) for word in row] for row in csv.reader(file.read_text(encoding="utf-8").splitlines())]
        (fx, _, cx), (_, fy, cy), _ = rows
    except (OSError, ValueError, csv.Error) as error:
        raise DataError(file, f"is no matrix of a camera ({error})", REMEDY) from None
    return fx, fy, cx, cy


def _frame(
    folder: Path, file: Path, number: int, row: dict[str, str], shared: tuple[float, float, float, float] | None
) -> ScanFrame:
    try:
        told = {name.strip(): value for name, value in row.items() if name}
        pose = np.array([float(told[name]) for name in POSE])
        fx, fy, cx, cy = shared or (float(told[name]) for name in FOCAL)
        w2c = inverse_rigid(pose_of(pose[3:], pose[:3]))
        saved = int(told.get("frame") or number)
    except (TypeError, ValueError) as error:  # of a line that ends early values are None
        raise DataError(file, f"line {number + 2} cannot be read ({error})", REMEDY) from None
    files = (existing(folder / kind / f"{saved:06d}.png") for kind in ("depth", "confidence"))
    return ScanFrame(number, w2c, (fx, fy, cx, cy), None, None, *files)
