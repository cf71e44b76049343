"""A circle around a model, or around what the cameras of a data set look at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..datasets.camera_paths import look_at
from ..render.framing import AUTOMATIC_FOV, ELEVATION, automatic_camera, robust_sphere
from ..scene.cameras import Camera, inverse_rigid
from ..scene.orientation import up_name
from ..scene.splats import Splats
from ..training.initialize import region_of_interest
from .camera_path import CameraPath, Lens, focal_of_camera, focal_of_fov
from .film_config import FilmConfig

LEVEL = 89.0  # degrees, of the steepest orbit
NEAREST = 1e-6  # of the distance of cameras at one place from the origin, or of 1: how far an orbit is from them
LARGEST_GAP = 120.0  # degrees between neighbours of a ring of cameras; with a wider one they stand on one side only


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What an orbit goes around, and how: it begins in the direction ``start`` [3] from ``centre`` [3].

    ``up`` [3] is a unit vector, ``elevation`` in degrees, ``focal`` over the shorter side of the picture.
    """

    centre: np.ndarray
    start: np.ndarray
    up: np.ndarray
    distance: float
    elevation: float
    focal: float


def around_model(splats: Splats, up: np.ndarray, fov: float | None) -> Surroundings:
    """A view of the whole core of a model; ``up`` [3] is its vertical."""
    centre, radius = robust_sphere(splats)
    start = automatic_camera(splats, up_name(up)).position - centre
    half = math.radians(AUTOMATIC_FOV if fov is None else fov) / 2
    return Surroundings(centre, start, up, radius / math.sin(half), ELEVATION, 0.5 / math.tan(half))


def around_cameras(cameras: Sequence[Camera], up: np.ndarray, fov: float | None) -> Surroundings:
    """The circle that the cameras of a data set stand on, as nearly as they do: from there a model was learnt.

    Of cameras that look around, it is about the middle of their places, at the pitch that they have.
    """
    positions = np.array([camera.position for camera in cameras])  # [V, 3]
    if _look_inwards(cameras):
        centre, least = region_of_interest(cameras)[0], 0.0
        sides = positions - centre  # [V, 3] from which they see it
    else:
        centre = positions.mean(0)
        least = NEAREST * max(1.0, float(np.linalg.norm(centre)))  # without a distance there is no direction
        sides = -_directions(cameras)
    distances = np.linalg.norm(positions - centre, axis=1)  # [V]
    focal = float(np.median([focal_of_camera(camera) for camera in cameras])) if fov is None else focal_of_fov(fov)
    elevation = float(np.clip(np.median(_rises(sides, up)), -LEVEL, LEVEL))
    return Surroundings(centre, sides[0], up, max(least, float(np.median(distances))), elevation, focal)


def around_camera(camera: Camera, centre: np.ndarray, up: np.ndarray, fov: float | None) -> Surroundings:
    """The circle that one camera stands on, and begins with its picture: about the place in the middle of that, as far
    away as ``centre`` [3] is. Where the camera looks away from there, about ``centre`` itself."""
    ahead = camera.w2c[2, :3]
    depth = float((centre - camera.position) @ ahead)
    centre = camera.position + depth * ahead if depth > 0 else centre
    side = camera.position - centre
    distance = max(float(np.linalg.norm(side)), NEAREST * max(1.0, float(np.linalg.norm(centre))))
    elevation = float(np.clip(_rises(side[None], up)[0], -LEVEL, LEVEL))
    focal = focal_of_camera(camera) if fov is None else focal_of_fov(fov)
    return Surroundings(centre, side, up, distance, elevation, focal)


def orbit(around: Surroundings, config: FilmConfig) -> CameraPath:
    """One turn around a vertical axis, the centre in the middle of the picture."""
    elevation = math.radians(around.elevation if config.elevation is None else config.elevation)
    distance = around.distance / config.zoom
    east, north = _horizontal(around.up, around.start)

    def at(share: float) -> Lens:
        azimuth = 2 * math.pi * share
        level = math.cos(azimuth) * east + math.sin(azimuth) * north
        position = around.centre + distance * (math.cos(elevation) * level + math.sin(elevation) * around.up)
        return Lens(inverse_rigid(look_at(position, around.centre, around.up)), around.focal)

    return CameraPath(at, True, f"an orbit, {round(math.degrees(elevation))} degrees above the horizon")


def stand_all_around(cameras: Sequence[Camera], up: np.ndarray) -> bool:
    """Whether cameras form a ring around what they look at, without a gap wider than ``LARGEST_GAP``."""
    if not _look_inwards(cameras):
        return False
    offsets = np.array([camera.position for camera in cameras]) - region_of_interest(cameras)[0]  # [V, 3]
    east, north = _horizontal(up, offsets[0])
    azimuths = np.sort(np.degrees(np.arctan2(offsets @ north, offsets @ east)))
    gaps = np.diff([*azimuths, azimuths[0] + 360])
    return bool(gaps.max() <= LARGEST_GAP)


def _look_inwards(cameras: Sequence[Camera]) -> bool:
    """Whether most cameras see what their axes meet at within 60 degrees of the middle of their pictures.

    Those that look around from one place do not: there rounding alone says on which side of it they stand.
    """
    inwards = region_of_interest(cameras)[0] - np.array([camera.position for camera in cameras])  # [V, 3]
    return bool(np.median((_unit(inwards) * _directions(cameras)).sum(1)) > 0.5)


def _directions(cameras: Sequence[Camera]) -> np.ndarray:
    """Unit vectors [V, 3] along the optical axes."""
    return np.array([camera.w2c[2, :3] for camera in cameras])


def _rises(sides: np.ndarray, up: np.ndarray) -> np.ndarray:
    """[V] degrees of directions [V, 3] above the horizon."""
    return np.degrees(np.arcsin(np.clip(_unit(sides) @ up, -1, 1)))


def _unit(vectors: np.ndarray) -> np.ndarray:
    """[V, 3] of length 1; what is 0 stays so."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)


def _horizontal(up: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors [3] across ``up``: the first as near to ``start`` as can be, the second a quarter turn further."""
    level = start - (start @ up) * up
    if np.linalg.norm(level) < 1e-6 * max(float(np.linalg.norm(start)), 1e-30):  # straight above or below
        axis = np.eye(3)[int(np.argmin(np.abs(up)))]
        level = axis - (axis @ up) * up
    east = level / np.linalg.norm(level)
    return east, np.cross(up, east)
