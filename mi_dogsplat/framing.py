"""Where a model is and how large, whatever floats far away from it; and a view that shows it whole."""

from __future__ import annotations

import math

import numpy as np

from .cameras import Camera
from .datasets.capture import look_at
from .splats import Splats

AUTOMATIC_SIZE = (800, 600)  # pixels
AUTOMATIC_FOV = 40.0  # degrees, of the shorter side
AUTOMATIC_DIRECTION = (1.0, -1.5, 0.8)  # from the model to the camera: from the front right, a little above; z is up
CORE = 0.8  # share of the primitives that count as the model


def robust_sphere(splats: Splats) -> tuple[np.ndarray, float]:
    """(centre [3], radius) of the core of a model: the median position, and how far the nearest 80 % reach.

    Two standard deviations of a median primitive are added to the radius, so that a model at a single point has
    an extent too. The unit sphere for a model without primitives.
    """
    if splats.n_splats == 0:
        return np.zeros(3), 1.0
    means = splats.means.astype(np.float64)
    centre = np.median(means, axis=0)  # [3]
    reach = float(np.quantile(np.linalg.norm(means - centre, axis=1), CORE))
    largest = np.clip(splats.log_scales.max(axis=1).astype(np.float64), -60, 60)  # [N]
    return centre, reach + 2 * float(np.exp(np.median(largest)))


def automatic_camera(splats: Splats) -> Camera:
    """A camera that frames the core of a model, for when nobody says where to look from."""
    centre, radius = robust_sphere(splats)
    width, height = AUTOMATIC_SIZE
    half = math.radians(AUTOMATIC_FOV) / 2
    direction = np.array(AUTOMATIC_DIRECTION) / np.linalg.norm(AUTOMATIC_DIRECTION)
    position = centre + direction * radius / math.sin(half)
    focal = 0.5 * min(width, height) / math.tan(half)
    return Camera(look_at(position, centre, "z"), focal, focal, width / 2, height / 2, width, height)
