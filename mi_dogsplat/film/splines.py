"""Smooth curves through key frames: positions and rotations with continuous acceleration.

Positions and lenses follow cubic splines, natural at open ends and periodic in loops. Rotations follow the spline of
``scipy.spatial.transform.RotationSpline``, whose angular velocity and acceleration are continuous too; in a loop its
keys are continued on both sides.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

CONTINUED = 12  # keys on each side of a loop of rotations; their influence falls fourfold from key to key


def vector_curve(times: np.ndarray, values: np.ndarray, period: float | None = None) -> Callable[[float], np.ndarray]:
    """A curve [D] through ``values`` [K, D] at increasing ``times`` [K]; ``period`` makes it a loop of that length."""
    if len(times) == 1:
        return lambda _: values[0]
    if period is None:
        spline = CubicSpline(times, values, bc_type="natural")
        return lambda t: spline(t)
    closed = CubicSpline([*times, times[0] + period], [*values, values[0]], bc_type="periodic")
    return lambda t: closed(t)


def rotation_curve(
    times: np.ndarray, rotations: np.ndarray, period: float | None = None
) -> Callable[[float], np.ndarray]:
    """Matrices [3, 3] through ``rotations`` [K, 3, 3] at increasing ``times`` [K]; ``period`` makes it a loop."""
    n = len(times)
    if n == 1:
        return lambda _: rotations[0]
    if period is not None:
        index = np.arange(-CONTINUED, n + CONTINUED + 1)
        times, rotations = times[index % n] + index // n * period, rotations[index % n]
    spline = RotationSpline(times, Rotation.from_matrix(rotations))
    return lambda t: spline(t).as_matrix()
