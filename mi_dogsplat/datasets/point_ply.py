"""Coloured point clouds from PLY files, as ``ply_file_path`` of a ``transforms.json`` names them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..scene.ply_tables import MAX_COLOR, RGB, TableReader, in_unit
from ..support.errors import DataError
from ..support.files import replacing

REMEDY = "write a PLY with an element vertex that has x y z and, for colours, red green blue"


def read_point_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """(points [P, 3] float32, colors [P, 3] float32 in 0..1; mid grey where the file has none).

    Raises ``DataError`` for a file that is no PLY, is damaged, has no vertices or a point that is not finite.
    """
    try:
        with path.open("rb") as file:
            reader = TableReader(path, file, path.stat().st_size)
            table = reader.tables({"vertex"}).get("vertex")
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror})", "correct ply_file_path or remove it") from error
    names = () if table is None else table.dtype.names or ()
    if table is None or not {"x", "y", "z"} <= set(names):
        raise DataError(path, "has no element vertex with x y z", REMEDY)
    with np.errstate(over="ignore"):  # doubles beyond float32 become infinite
        points = np.stack([table[axis] for axis in "xyz"], axis=1).astype(np.float32)  # [P, 3]
    if not np.isfinite(points).all():
        raise DataError(path, "a point is not finite", REMEDY)
    if not set(RGB) <= set(names):
        return points, np.full_like(points, 0.5)
    colors = np.stack([table[channel] for channel in RGB], axis=1)  # [P, 3]
    if not np.isfinite(colors).all() or np.abs(colors).max(initial=0) > MAX_COLOR:
        raise DataError(path, "a colour has no valid value", REMEDY)
    return points, in_unit(colors, reader.codes["vertex"]["red"])


def write_point_ply(path: Path, points: np.ndarray, colors: np.ndarray) -> None:
    """Write points [P, 3] and sRGB colours [P, 3] in 0..1 as a binary PLY with 8-bit colours."""
    rows = np.empty(len(points), [("xyz", "<f4", 3), ("rgb", "u1", 3)])  # [P]
    rows["xyz"] = points
    rows["rgb"] = np.round(np.clip(colors, 0, 1) * 255)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in "xyz"]
    header += [f"property uchar {name}" for name in RGB]
    with replacing(path) as part:
        part.write_bytes("\n".join([*header, "end_header\n"]).encode() + rows.tobytes())
