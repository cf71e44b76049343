"""A COLMAP model without observations, as text: cameras with poses, and points that no image says it sees."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..scene.cameras import Camera
from ..scene.quaternions import WXYZ_FROM_XYZW, quaternion_from_rotation


def write_colmap(folder: Path, views: Sequence[tuple[str, Camera]], points: np.ndarray, colors: np.ndarray) -> None:
    """Write ``cameras.txt``, ``images.txt`` and ``points3D.txt`` into a folder that is there. Raises ``OSError``.

    Args:
        folder: to write into.
        views: names of images, with their cameras; those of the same intrinsics share one of the model.
        points: [P, 3] in world space.
        colors: [P, 3] sRGB in 0..1.
    """
    pinholes = [(c.width, c.height, c.fx, c.fy, c.cx, c.cy) for _, c in views]
    ids = {pinhole: number for number, pinhole in enumerate(dict.fromkeys(pinholes), 1)}
    cameras = [f"{number} PINHOLE {w} {h} {_row(values)}" for (w, h, *values), number in ids.items()]
    images = []
    for number, ((name, camera), pinhole) in enumerate(zip(views, pinholes, strict=True), 1):
        quaternion = quaternion_from_rotation(camera.w2c[:3, :3])[WXYZ_FROM_XYZW]
        images += [f"{number} {_row(quaternion)} {_row(camera.w2c[:3, 3])} {ids[pinhole]} {name}", ""]
    levels = np.rint(255 * np.clip(colors, 0, 1)).astype(int)
    rows = [
        f"{number} {_row(point)} {_row(color)} 0"
        for number, (point, color) in enumerate(zip(points.tolist(), levels.tolist(), strict=True), 1)
    ]
    for name, lines in (("cameras", cameras), ("images", images), ("points3D", rows)):
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _row(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(repr(value) for value in np.asarray(values).tolist())
