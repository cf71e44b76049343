"""The world that poses are given in: structure from motion leaves its origin, its axes and its unit open.

Here x points right, y down and z ahead, the way OpenCV's cameras and most viewers of splats have it: up is -y. The
origin is in the middle of the points. The unit stays COLMAP's, unless two images are known to be so far apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..datasets.dataset import view_name
from ..support.errors import DataError

TOWARDS_MEAN = 0.02  # weight of the mean up of the images: decides where all cameras have the same horizontal


@dataclass(frozen=True)
class Scale:
    """Two images by their names, and how far their cameras stand apart, in whatever unit.

    Names as in the folder that is written, or those of the views (``view_name``).
    """

    first: str
    second: str
    length: float


def upright(c2w: np.ndarray) -> np.ndarray:
    """The rotation [3, 3] of the world after which up is -y, by cameras [N, 4, 4] (OpenCV axes).

    Cameras are mostly held level: their horizontals lie across the vertical, however steeply they look. So up is the
    direction that fits that best by least squares, and where several do, the one nearest to the mean up of the images,
    which are upright. Ahead is where the cameras look, on the whole.
    """
    right, down, ahead = np.moveaxis(c2w[:, :3, :3], 2, 0)  # [N, 3] each
    mean = _unit(-down.mean(axis=0), -down[0])
    across = right.T @ right / len(right) + TOWARDS_MEAN * (np.eye(3) - np.outer(mean, mean))  # [3, 3]
    up = np.linalg.eigh(across)[1][:, 0]
    up = up if up @ mean >= 0 else -up
    level = [v - up * (up @ v) for v in (ahead.mean(axis=0), ahead[0], right[0])]
    z = next(v for v in level if np.linalg.norm(v) > 0.1 or v is level[-1])
    z = z / np.linalg.norm(z)
    return np.stack([np.cross(-up, z), -up, z])


def place(pycolmap: Any, model: Any, scale: Scale | None) -> None:
    """Move, turn and scale a model of pycolmap's in place. Raises ``DataError`` for images without a pose."""
    images = sorted((image for image in model.images.values() if image.has_pose), key=lambda image: image.name)
    c2w = np.stack([np.vstack([image.cam_from_world().inverse().matrix(), [0, 0, 0, 1]]) for image in images])
    factor = 1.0
    if scale is not None:
        names = [name for image in images for name in (image.name, view_name(image.name))]
        at = dict(zip(names, np.repeat(c2w[:, :3, 3], 2, axis=0), strict=True))
        for name in (scale.first, scale.second):
            if name not in at:
                raise DataError("--scale", f'no image "{name}" has a pose', f"name two of them, like {images[0].name}")
        factor = scale.length / max(float(np.linalg.norm(at[scale.first] - at[scale.second])), 1e-12)
    rotation = upright(c2w)
    points = np.array([point.xyz for point in model.points3D.values()]) @ rotation.T  # [P, 3]
    model.transform(pycolmap.Sim3d(factor, pycolmap.Rotation3d(rotation), -factor * np.median(points, axis=0)))


def _unit(vector: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The vector at length 1; the other one where it is about 0."""
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-3 else other
