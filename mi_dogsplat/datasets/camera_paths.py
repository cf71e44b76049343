"""Camera paths around a scene: an orbit or a hemisphere, framed by a sphere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..scene.cameras import Camera, inverse_rigid
from ..scene.orientation import AXES, rotation_between, up_vector
from .capture_config import CaptureConfig

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))
NEAR = 1e-3  # clipping distance, times the distance of what is framed
FAR = 1e37  # beyond any sky: a dome may be larger than what it stands around by any factor


@dataclass(frozen=True, eq=False)
class Shot:
    """A view to render: its file name without extension, its camera, and the sensor's clipping distances."""

    name: str
    camera: Camera
    near_clip: float
    far_clip: float


def circling_shots(config: CaptureConfig, n: int, center: np.ndarray, radius: float, up: str) -> list[Shot]:
    """``n`` cameras on a sphere, all looking at ``center`` [3], far enough to frame a sphere of ``radius``."""
    width, height = config.size
    focal = 0.5 * max(width, height) / math.tan(math.radians(config.fov) / 2)
    narrow = math.atan(0.5 * min(width, height) / focal)  # half the angle of the shorter side
    distance = radius / math.sin(narrow) / config.zoom
    intrinsics = (focal, focal, width / 2, height / 2, width, height)
    place = orbit if config.path == "orbit" else hemisphere
    positions = center + distance * place(n, up, config.band)  # [n, 3]
    cameras = [Camera(look_at(position, center, up), *intrinsics) for position in positions]
    return [Shot(f"{i:03d}", camera, NEAR * distance, FAR) for i, camera in enumerate(cameras)]


def hemisphere(n: int, up: str, elevations: tuple[float, float]) -> np.ndarray:
    """Unit vectors float64 [n, 3] on a Fibonacci spiral, evenly spread over a band of elevations in degrees."""
    return _on_sphere(_rises(n, elevations), GOLDEN_ANGLE * np.arange(n), up)


def orbit(n: int, up: str, elevations: tuple[float, float]) -> np.ndarray:
    """Unit vectors float64 [n, 3] along a path around the axis ``up`` that climbs through a band of elevations.

    Neighbours on the path, and neighbouring turns, are about equally far apart, but there is at least one full turn
    (the generalized spiral of Rakhmanov, Saff and Zhou 1994, kept to a band).
    """
    rise = _rises(n, elevations)
    low, high = np.sin(np.radians(elevations))
    spacing = math.sqrt(2 * math.pi * (high - low) / n)  # side of a square with a view's share of the band
    steps = np.full(n, 2 * math.pi / n)  # [n] radians of azimuth: one turn
    if spacing:
        steps = spacing / np.sqrt(1 - rise**2)
        steps *= max(1.0, 2 * math.pi / steps.sum())
    return _on_sphere(rise, np.cumsum(steps) - steps[0], up)


def _rises(n: int, elevations: tuple[float, float]) -> np.ndarray:
    """Heights [n] on the unit sphere in the middle of ``n`` zones of equal area."""
    low, high = np.sin(np.radians(elevations))
    return low + (high - low) * (np.arange(n) + 0.5) / n


def _on_sphere(rise: np.ndarray, azimuth: np.ndarray, up: str) -> np.ndarray:
    """Unit vectors [n, 3] at these heights along ``up`` and angles around it."""
    flat = np.sqrt(1 - rise**2)
    directions = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), rise], axis=1)  # [n, 3], up is z
    if up not in AXES:
        return directions @ rotation_between(up_vector("z"), up_vector(up)).T
    if up[0] == "-":
        directions *= (1, -1, -1)  # half a turn about x keeps the sense of rotation about the axis
    return np.roll(directions, {"x": 1, "y": 2, "z": 0}[up[-1]], axis=1)


def look_at(position: np.ndarray, target: np.ndarray, up: str | np.ndarray) -> np.ndarray:
    """OpenCV world-to-camera [4, 4] of a camera that looks at ``target``; ``up``, an axis or vector [3], is upright."""
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, up_vector(up) if isinstance(up, str) else up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    c2w = np.eye(4)
    c2w[:3] = np.stack([right, down, forward, position], axis=1)
    return inverse_rigid(c2w)
