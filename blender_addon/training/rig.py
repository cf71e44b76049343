"""Where the cameras of a rig stand: around a scene as those of ``dogsplat capture``, or inside of a room.

This is numbers alone, with z up.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..cameras.camera import Camera
from ..files.errors import told

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))
PLASTIC = 1.2207440846057596  # of three dimensions: the root of x^4 = x + 1 (Roberts 2018, "R3 sequence")
ROOM = 0.6  # of the box in which cameras inside of it stand, around its middle
TRIES = 32  # places that are looked at for each camera inside


def spiral(n: int, elevations: tuple[float, float]) -> np.ndarray:
    """Unit vectors [n, 3] on a Fibonacci spiral, evenly spread over a band of elevations in degrees."""
    low, high = np.sin(np.radians(elevations))
    rise = low + (high - low) * (np.arange(n) + 0.5) / n
    azimuth, flat = GOLDEN_ANGLE * np.arange(n), np.sqrt(1 - rise**2)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), rise], axis=1)


def distance(radius: float, lens: Camera, zoom: float) -> float:
    """From which a sphere just fits into the picture, its shorter side too; at a zoom of 2 it is twice as large."""
    narrow = min(math.atan(0.5 * lens.width / lens.fx), math.atan(0.5 * lens.height / lens.fy))
    return radius / math.sin(narrow) / zoom


def around(center: np.ndarray, distance: float, n: int, elevations: tuple[float, float]) -> list[np.ndarray]:
    """Camera-to-world matrices [4, 4] in Blender's axes, all of cameras that look at ``center`` [3]."""
    directions = spiral(n, elevations)
    return [looking(center + distance * direction, -direction) for direction in directions]


def inside(
    low: np.ndarray, high: np.ndarray, n: int, elevations: tuple[float, float], is_free: Callable[[np.ndarray], bool]
) -> list[np.ndarray]:
    """The same of cameras spread over a box from ``low`` [3] to ``high``, which look into all directions of a band.

    ``is_free`` says whether a camera can stand at a place [3]. Raises ``ValueError`` where there is too little room.
    """
    places = []
    for k in range(TRIES * n):
        share = (0.5 + (k + 1) / PLASTIC ** np.arange(1, 4)) % 1  # [3]
        place = low + (high - low) * (0.5 + ROOM * (share - 0.5))
        if is_free(place):
            places.append(place)
        if len(places) == n:
            return [looking(place, way) for place, way in zip(places, spiral(n, elevations), strict=True)]
    problem = "there is room for {found} of {n} cameras inside; use fewer, or mark an emptier region"
    raise ValueError(told(problem, found=len(places), n=n))


def looking(place: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Camera-to-world [4, 4] of an upright camera at ``place`` [3] that looks along the unit vector ``way`` [3]."""
    right = np.cross(way, (0.0, 0.0, 1.0))
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-9 else np.array([1.0, 0.0, 0.0])
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(right, way), -way, place], axis=1)
    return matrix


def held_out(n: int) -> set[int]:
    """Which of ``n`` views are for testing: one for six that are trained on, spread evenly, as ``dogsplat capture``."""
    n_test = n // 7
    return {int((k + 0.5) * n / n_test) for k in range(n_test)}
