"""The world that poses are given in: structure from motion leaves its origin, its axes and its unit open.

Here x points right, y down and z ahead, the way OpenCV's cameras and most viewers of splats have it: up is -y. The
origin is in the middle of the points. The unit stays COLMAP's, or is a metre where a length is known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..datasets.lengths import Standpoint, length_in_units
from ..datasets.world import World, metres
from ..scene.orientation import UP, up_of_cameras

FEWEST = 3  # images that tell where down is
AGREED = 10.0  # degrees: how far the median of them may be from what they say together
SWEEPS = 20  # of the median direction


@dataclass(frozen=True)
class Placed:
    """What a model has become: its world, and in words how up was found."""

    world: World
    up_from: str


def place(pycolmap: Any, model: Any, scale: tuple[str, str, str] | None, downs: Mapping[str, np.ndarray]) -> Placed:
    """Move, turn and scale a model of pycolmap's in place.

    Args:
        scale: places and a length in metres (``lengths.py``).
        downs: where down was for single images, by name: a vector [3] in the axes of the camera (OpenCV).

    Raises ``DataError`` for places that are none.
    """
    images = sorted((image for image in model.images.values() if image.has_pose), key=lambda image: image.name)
    c2w = np.stack([np.vstack([image.cam_from_world().inverse().matrix(), [0, 0, 0, 1]]) for image in images])
    factor = 1.0
    if scale is not None:
        factor = metres(scale) / length_in_units(scale[:2], _standpoints(model, images, c2w))
    held = [c2w[i, :3, :3] @ downs[image.name] for i, image in enumerate(images) if image.name in downs]
    up, up_from = _up(c2w, np.array(held).reshape(-1, 3))
    rotation = upright(c2w, up)
    points = np.array([point.xyz for point in model.points3D.values()]) @ rotation.T  # [P, 3]
    model.transform(pycolmap.Sim3d(factor, pycolmap.Rotation3d(rotation), -factor * np.median(points, axis=0)))
    return Placed(World(UP, None if scale is None else 1.0), up_from)


def upright(c2w: np.ndarray, up: np.ndarray) -> np.ndarray:
    """The rotation [3, 3] of the world after which ``up`` [3] is -y; ahead is where cameras [N, 4, 4] look, on the
    whole."""
    right, _, ahead = np.moveaxis(c2w[:, :3, :3], 2, 0)  # [N, 3] each
    level = [v - up * (up @ v) for v in (ahead.mean(axis=0), ahead[0], right[0])]
    z = next(v for v in level if np.linalg.norm(v) > 0.1 or v is level[-1])
    z = z / np.linalg.norm(z)
    return np.stack([np.cross(-up, z), -up, z])


def _up(c2w: np.ndarray, downs: np.ndarray) -> tuple[np.ndarray, str]:
    """Up [3] by what images say [M, 3], where enough of them agree, else as cameras were held; and which, in words.

    What images say is blurred by how the hand moved, so their median direction counts (Weiszfeld 1937).
    """
    by_cameras = "as the cameras were held, because no image says where down is"
    if len(downs) < FEWEST:
        return up_of_cameras(c2w), by_cameras
    middle = downs.mean(axis=0)
    for _ in range(SWEEPS):
        weights = 1 / np.maximum(np.linalg.norm(downs - middle, axis=1), 1e-6)
        middle = weights @ downs / weights.sum()
    length = float(np.linalg.norm(middle))
    cosines = downs @ middle / max(length, 1e-12)
    off = float(np.degrees(np.arccos(np.clip(np.median(cosines), -1, 1))))
    if off > AGREED:
        return up_of_cameras(c2w), f"as the cameras were held; {len(downs)} images say where down is, but disagree"
    return -middle / length, f"as {len(downs)} images say where down is; they agree to {off:.1f} degrees"


def _standpoints(model: Any, images: list[Any], c2w: np.ndarray) -> dict[str, Standpoint]:
    """Where the images of a model of pycolmap's were taken, and what they see."""

    def of(image: Any, pose: np.ndarray) -> Standpoint:
        camera = model.cameras[image.camera_id]

        def ray(pixel: np.ndarray) -> np.ndarray:
            inside = camera.cam_from_img(pixel)  # None where the lens has no ray
            direction = np.append(np.full(2, np.nan) if inside is None else inside, 1.0)
            return pose[:3, :3] @ direction / np.linalg.norm(direction)

        seen = [model.points3D[p.point3D_id].xyz for p in image.points2D if p.has_point3D()]
        return Standpoint(pose[:3, 3], ray, np.array(seen).reshape(-1, 3))

    return {image.name: of(image, pose) for image, pose in zip(images, c2w, strict=True)}
