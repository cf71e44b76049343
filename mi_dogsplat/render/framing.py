"""Where a model is and how large, whatever floats far away from it; and a view that shows it whole."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..datasets.camera_paths import circling_shots, look_at
from ..datasets.capture_config import CaptureConfig
from ..scene.cameras import Camera
from ..scene.drawing import Drawing, DrawnAs, drawn_as
from ..scene.orientation import up_name, up_vector
from ..scene.splats import Splats

AUTOMATIC_SIZE = (800, 600)  # pixels
AUTOMATIC_FOV = 40.0  # degrees, of the shorter side
ELEVATION = 25.0  # degrees above the horizon
CORE = 0.9  # share of the primitives that count as the model
MIN_SKEW = 0.2  # below, no axis stands out as the vertical
ELEVATIONS_AROUND = (0.0, 60.0)  # degrees, of cameras around a model
NEAR_SHARE = 0.1  # of the radius of a model framed automatically, which may be far smaller than the near clip


def robust_sphere(splats: Splats) -> tuple[np.ndarray, float]:
    """(centre [3], radius) of the core of a model: the median position, and how far the nearest 90 % reach.

    Two standard deviations of a median primitive are added to the radius, so that a model at a single point
    has an extent too; it is at least what float32 tells apart there. The unit sphere for a model without primitives.
    """
    if splats.n_splats == 0:
        return np.zeros(3), 1.0
    means = splats.means.astype(np.float64)
    centre = np.median(means, axis=0)  # [3]
    reach = float(np.quantile(np.linalg.norm(means - centre, axis=1), CORE))
    largest = np.clip(splats.log_scales.max(axis=1).astype(np.float64), -60, 60)  # [N]
    least = float(np.finfo(np.float32).eps * np.abs(centre).max())
    return centre, max(reach + 2 * float(np.exp(np.median(largest))), least)


def likely_up(splats: Splats) -> np.ndarray:
    """A guess at the vertical, one of the six axis directions [3]; z where nothing tells.

    What stands on a ground has most of its primitives low and a few high, so the axis with the most lopsided
    distribution is the vertical, and its long tail is up. Reconstructions from photographs tend to have y
    down, modelled scenes z up: no fixed axis would do.
    """
    if splats.n_splats == 0:
        return np.array([0.0, 0.0, 1.0])
    low, middle, high = np.quantile(splats.means.astype(np.float64), [0.02, 0.5, 0.98], axis=0)  # [3] each
    skew = (high + low - 2 * middle) / np.maximum(high - low, 1e-30)  # [3] in -1..1
    axis = int(np.argmax(abs(skew)))
    if abs(skew[axis]) < MIN_SKEW:
        return np.array([0.0, 0.0, 1.0])
    return np.eye(3)[axis] * np.sign(skew[axis])


def vertical(splats: Splats, up_axis: str | None) -> np.ndarray:
    """The vertical [3] that a file tells (``Drawing.up``), else the likely one."""
    return up_vector(up_axis) if up_axis else likely_up(splats)


def near_clip_for(splats: Splats, near_clip: float, asked: float | None) -> float:
    """The near clip of views that may stand close to a small model: what was ``asked`` for, else ``near_clip`` or
    less."""
    return min(near_clip, NEAR_SHARE * robust_sphere(splats)[1]) if asked is None else asked


def drawn_without_data(splats: Splats, asked: Drawing, file: Drawing, chosen: bool = False) -> DrawnAs:
    """How a model is drawn whose photographs are not there, which may be small.

    asked, file: what is asked for, and what the model's file says.
    chosen: whether somebody says from where it is seen. Then the near clip of the file holds, too.
    """
    said = asked.over(file)
    drawn = drawn_as(said)
    return replace(
        drawn, near_clip=near_clip_for(splats, drawn.near_clip, said.near_clip if chosen else asked.near_clip)
    )


def automatic_camera(splats: Splats, up_axis: str | None = None) -> Camera:
    """A camera that frames the core of a model, for when nobody says where to look from.

    ``up_axis``: what stands upright, as in ``Drawing.up``; None: a guess.
    """
    centre, radius = robust_sphere(splats)
    up = vertical(splats, up_axis)
    sideways = np.roll(abs(up), 1) + 1.5 * np.roll(abs(up), 2)  # [3] off all axes
    sideways -= (sideways @ up) * up
    elevation = math.radians(ELEVATION)
    offset = math.sin(elevation) * up - math.cos(elevation) * sideways / np.linalg.norm(sideways)
    half = math.radians(AUTOMATIC_FOV) / 2
    position = centre + offset * radius / math.sin(half)
    width, height = AUTOMATIC_SIZE
    focal = 0.5 * min(width, height) / math.tan(half)
    return Camera(look_at(position, centre, up), focal, focal, width / 2, height / 2, width, height)


def cameras_around(splats: Splats, n: int, up_axis: str | None = None) -> list[Camera]:
    """``n`` cameras on a hemisphere that frame the core of a model, for when nobody says from where to compare."""
    centre, radius = robust_sphere(splats)
    up = up_name(vertical(splats, up_axis))
    config = CaptureConfig(size=AUTOMATIC_SIZE, fov=AUTOMATIC_FOV, elevations=ELEVATIONS_AROUND)
    return [shot.camera for shot in circling_shots(config, n, centre, radius, up)]
