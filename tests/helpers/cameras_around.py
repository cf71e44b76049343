"""Views of the small random scenes from several sides."""

import numpy as np
from mi_dogsplat.scene.cameras import Camera, affine
from splat_scenes import axis_rotation, make_camera

MIDDLE = 0, 0, 3  # of the primitives


def cameras_around(spread: float, n: int, width: int, height: int, f: float) -> list[Camera]:
    """n cameras on an arc about the primitives, from ``-spread`` to ``spread`` radians."""
    views = []
    for angle in np.linspace(-spread, spread, n):
        turn, _ = axis_rotation([0.4, 1, 0.2 * angle], angle)
        views.append(make_camera(width, height, f, w2c=affine(turn, MIDDLE - turn @ MIDDLE)))
    return views
