"""Curves through key frames: they pass through them, stay rotations, and close."""

import numpy as np
import pytest
from mi_dogsplat.film.splines import rotation_curve, vector_curve
from scipy.spatial.transform import Rotation

TIMES = np.array([0.0, 0.4, 1.0, 2.5, 3.0, 4.2])
BETWEEN = np.linspace(-0.5, 6.0, 80)


def keys(n: int = 6) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return rng.normal(size=(n, 3)), Rotation.from_quat(rng.normal(size=(n, 4))).as_matrix()


@pytest.mark.parametrize("period", [None, 5.0])
@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_curves_pass_through_their_keys(n, period):
    positions, rotations = keys(n)
    place, turn = vector_curve(TIMES[:n], positions, period), rotation_curve(TIMES[:n], rotations, period)
    for time, position, rotation in zip(TIMES, positions, rotations, strict=False):
        np.testing.assert_allclose(place(time), position, atol=1e-12)
        np.testing.assert_allclose(turn(time), rotation, atol=1e-12)


@pytest.mark.parametrize("period", [None, 5.0])
def test_between_keys_rotations_are_rotations(period):
    turn = rotation_curve(TIMES, keys()[1], period)
    for time in BETWEEN if period else np.clip(BETWEEN, TIMES[0], TIMES[-1]):
        matrix = turn(time % 5.0 if period else time)
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(matrix) == pytest.approx(1)


def test_a_loop_ends_as_it_begins_with_the_same_speed_and_acceleration():
    """Else a film that is shown in a loop would jerk once in each round."""
    positions, rotations = keys()
    h = 1e-4
    for curve in (vector_curve(TIMES, positions, 5.0), rotation_curve(TIMES, rotations, 5.0)):
        np.testing.assert_allclose(curve(5.0), curve(0.0), atol=1e-9)
        speeds = [(curve(end) - curve(end - h)) / h for end in (5.0, h)]
        accelerations = [(curve(end) - 2 * curve(end - h) + curve(end - 2 * h)) / h**2 for end in (5.0, 2 * h)]
        assert abs(speeds[1] - speeds[0]).max() < 1e-2 * abs(speeds[0]).max()
        assert abs(accelerations[1] - accelerations[0]).max() < 1e-2 * abs(accelerations[0]).max()


def test_an_even_motion_is_followed_exactly():
    """A line at constant speed and a turn at a constant rate are what interpolation must not disturb."""
    line = np.outer(TIMES, [1.0, -2.0, 0.5])
    axis = np.array([0.6, 0.0, 0.8])
    turns = Rotation.from_rotvec(np.outer(TIMES, axis)).as_matrix()
    place, turn = vector_curve(TIMES, line), rotation_curve(TIMES, turns)
    for time in np.linspace(0, 4.2, 29):
        np.testing.assert_allclose(place(time), time * np.array([1.0, -2.0, 0.5]), atol=1e-12)
        np.testing.assert_allclose(turn(time), Rotation.from_rotvec(time * axis).as_matrix(), atol=1e-9)


def test_acceleration_is_continuous_at_a_key():
    positions, rotations = keys()
    h = 1e-4
    for curve in (vector_curve(TIMES, positions), rotation_curve(TIMES, rotations)):
        for time in TIMES[1:-1]:
            before, after = ((curve(t + h) - 2 * curve(t) + curve(t - h)) / h**2 for t in (time - h, time + h))
            assert abs(after - before).max() < 1e-2 * abs(before).max()
