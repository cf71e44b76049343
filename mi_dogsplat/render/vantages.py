"""Cameras that see all of a model, for when there are no photographs: from around it, and from free places inside.

From around, an object is seen whole. What is inside a room, or behind a hand, is seen from near it only: these
cameras stand where no primitive is within reach, and each looks at a primitive drawn by how much there is of it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

from ..datasets.camera_paths import hemisphere, look_at
from ..scene.cameras import Camera
from ..scene.orientation import up_name
from ..scene.splats import Array, Splats
from .framing import AUTOMATIC_FOV, robust_sphere, vertical

ELEVATIONS = (-30.0, 80.0)  # degrees, of cameras around a model
NEAR_FOV = 60.0  # degrees, of the shorter side, of cameras inside
CLEARANCE = 0.1  # of the radius: what is free around a camera inside
REACH = 1.2  # of the radius: how far from the centre cameras inside are
DEVIATIONS = 2.0  # of a primitive, along its longest axis, that are not free
SUPPORT = 32  # primitives nearest to a place that are looked at
TRIALS = 40  # places tried for each camera


def vantage_cameras(
    splats: Splats,
    n: int,
    size: tuple[int, int],
    seed: int = 0,
    share_inside: float = 0.5,
    up_axis: str | None = None,
) -> list[Camera]:
    """``n`` cameras around a model and, as far as there are free places, a share of them inside.

    Args:
        splats: at least one primitive.
        size: width and height in pixels.
        seed: of the places; other seeds give other views.
        share_inside: 0..1.
        up_axis: what stands upright, as in ``Drawing.up``; None: a guess.
    """
    rng, axis = np.random.default_rng(seed), vertical(splats, up_axis)
    inside = cameras_inside(splats, round(share_inside * n), size, rng, axis)
    return [*cameras_outside(splats, n - len(inside), size, rng, axis), *inside]


def cameras_outside(
    splats: Splats, n: int, size: tuple[int, int], rng: np.random.Generator, axis: Array
) -> list[Camera]:
    """Evenly spread over a band of a sphere about the vertical ``axis`` [3], from a random azimuth on; each frames the
    core of the model."""
    centre, radius = robust_sphere(splats)
    up, half = up_name(axis), math.radians(AUTOMATIC_FOV) / 2
    directions = hemisphere(n, up, ELEVATIONS)  # [n, 3]
    angle = rng.uniform(0, 2 * np.pi)
    along = directions @ axis
    turned = np.cos(angle) * directions + np.sin(angle) * np.cross(axis, directions)
    turned += ((1 - np.cos(angle)) * along)[:, None] * axis
    return [_camera(centre + d * radius / math.sin(half), centre, up, size, AUTOMATIC_FOV) for d in turned]


def cameras_inside(
    splats: Splats, n: int, size: tuple[int, int], rng: np.random.Generator, axis: Array
) -> list[Camera]:
    """At most ``n`` at free places near the core of a model, each looking at one of its primitives; maybe none."""
    if n == 0:
        return []
    centre, radius = robust_sphere(splats)
    up = up_name(axis)
    means = splats.means.astype(np.float64)
    longest = splats.scales.max(axis=1).astype(np.float64)  # [N]
    steps = rng.normal(size=(TRIALS * n, 3))
    steps *= (REACH * radius * rng.uniform(size=len(steps)) / np.linalg.norm(steps, axis=1))[:, None]
    places = centre + steps  # [trials, 3] evenly far from the centre: in a ball most places are near its surface
    distances, near = cKDTree(means).query(places, min(SUPPORT, len(means)))
    distances, near = distances.reshape(len(places), -1), near.reshape(len(places), -1)
    clear = (distances - DEVIATIONS * longest[near]).min(axis=1) > CLEARANCE * radius
    core = np.flatnonzero(np.linalg.norm(means - centre, axis=1) <= radius)
    targets = means[rng.choice(core, len(places), p=_amounts(splats)[core] / _amounts(splats)[core].sum())]
    steep = np.abs((targets - places) @ axis) > 0.99 * np.linalg.norm(targets - places, axis=1)
    chosen = np.flatnonzero(clear & ~steep)[:n]  # looking along the vertical a camera has no upright
    return [_camera(places[k], targets[k], up, size, NEAR_FOV) for k in chosen]


def _amounts(splats: Splats) -> Array:
    """[N] opacity over the largest face of each primitive; of scales beyond float32 a very large one."""
    scales = np.exp(np.sort(np.clip(splats.log_scales.astype(np.float64), -60, 60), axis=1))
    return splats.opacities * scales[:, 1] * scales[:, 2] + 1e-300


def _camera(position: Array, target: Array, up: str, size: tuple[int, int], fov: float) -> Camera:
    width, height = size
    focal = 0.5 * min(width, height) / math.tan(math.radians(fov) / 2)
    return Camera(look_at(position, target, up), focal, focal, width / 2, height / 2, width, height)
