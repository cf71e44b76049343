"""Six numbers as a motion of a camera, the gradient by them, and what all cameras have in common."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.scene.camera_motions import (
    BLOCK,
    DAMPING,
    common_motions,
    motion_gradient,
    moved_w2c,
    preconditioners,
    without_common,
)
from mi_dogsplat.scene.cameras import affine, inverse_rigid
from scipy.spatial.transform import Rotation

EXTENT = 3.3
GIVEN: Any = np.array([camera.w2c for camera in tiny_data.cameras()])


def motion_matrix(motion: np.ndarray) -> np.ndarray:
    """M of the module's docstring, by scipy."""
    return affine(Rotation.from_rotvec(motion[:3]).as_matrix(), EXTENT * motion[3:])


@pytest.mark.parametrize("size", [0, 1e-9, 1e-4, 0.02, 0.5, 2])
def test_a_motion_acts_on_the_right_of_camera_to_world(size):
    motions = size * np.random.default_rng(0).normal(size=(len(GIVEN), 6))
    moved = moved_w2c(GIVEN, motions, EXTENT)
    for given, got, motion in zip(GIVEN, moved, motions, strict=True):
        np.testing.assert_allclose(inverse_rigid(got), inverse_rigid(given) @ motion_matrix(motion), atol=1e-12)


@pytest.mark.parametrize("size", [0, 1e-7, 1e-3, 0.3, 1.5])
def test_the_gradient_by_a_motion_is_that_of_differences_though_it_is_found_by_a_further_motion(size):
    rng = np.random.default_rng(1)
    motions, weights = size * rng.normal(size=(len(GIVEN), 6)), rng.normal(size=(len(GIVEN), 4, 4))

    def f(w2c: np.ndarray) -> np.ndarray:
        return np.sin(weights * w2c).sum(axis=(1, 2))  # [V]

    def difference(of_step: Any, step: float = 1e-6) -> np.ndarray:
        return np.stack([(f(of_step(step * e)) - f(of_step(-step * e))) / (2 * step) for e in np.eye(6)], -1)

    def further(step: np.ndarray) -> np.ndarray:
        result = []
        for w2c in moved_w2c(GIVEN, motions, EXTENT):
            c2w = inverse_rigid(w2c)
            c2w[:3, :3] = c2w[:3, :3] @ Rotation.from_rotvec(step[:3]).as_matrix()
            c2w[:3, 3] += step[3:]
            result.append(inverse_rigid(c2w))
        return np.array(result)

    got = motion_gradient(GIVEN, motions, EXTENT, difference(further))
    expected = difference(lambda step: moved_w2c(GIVEN, motions + step, EXTENT))
    np.testing.assert_allclose(got, expected, atol=2e-8)


def motions_of_a_world(size: float) -> np.ndarray:
    """Of the cameras, [V, 6], when the world is turned, shifted and scaled by ``size``."""
    rng = np.random.default_rng(2)
    turn, shift = Rotation.from_rotvec(size * rng.normal(size=3)).as_matrix(), size * rng.normal(size=3)
    motions = []
    for w2c in GIVEN:
        c2w = inverse_rigid(w2c)
        after = c2w.copy()
        after[:3, :3], after[:3, 3] = turn @ c2w[:3, :3], (1 + size) * turn @ c2w[:3, 3] + shift
        M = inverse_rigid(c2w) @ after
        motions.append([*Rotation.from_matrix(M[:3, :3]).as_rotvec(), *M[:3, 3] / EXTENT])
    return np.array(motions)


def test_a_motion_and_scaling_of_the_world_is_taken_out_to_first_order():
    basis = common_motions(GIVEN, EXTENT)
    np.testing.assert_allclose(basis.T @ basis, np.eye(7), atol=1e-12)
    left = [np.abs(without_common(motions_of_a_world(size), basis)).max() for size in (0.02, 0.01)]
    assert left[1] < 0.02 * np.abs(motions_of_a_world(0.01)).max()
    assert left[0] / left[1] == pytest.approx(4, rel=0.1)  # what is left is of second order


def test_what_single_cameras_do_stays_but_for_their_mean():
    basis, motions = common_motions(GIVEN, EXTENT), np.zeros((len(GIVEN), 6))
    motions[3] = 0.01, 0, 0, 0, 0.02, 0
    left = without_common(motions, basis)
    np.testing.assert_allclose(without_common(left, basis), left, atol=1e-15)
    np.testing.assert_allclose(basis.T @ left.ravel(), 0, atol=1e-15)
    assert np.linalg.norm(left[3]) > 0.7 * np.linalg.norm(motions[3])
    assert np.linalg.norm(left[3]) > 3 * np.linalg.norm(np.delete(left, 3, axis=0), axis=1).max()


def test_cameras_at_one_place_have_no_scale_and_a_single_one_nothing_of_its_own():
    turns = np.random.default_rng(0).normal(size=(3, 6)) * (1, 1, 1, 0, 0, 0)
    turned = moved_w2c(GIVEN[:1].repeat(3, 0), turns, EXTENT)
    assert common_motions(turned, EXTENT).shape == (18, 6)
    alone = common_motions(GIVEN[:1], EXTENT)
    np.testing.assert_allclose(without_common(np.ones((1, 6)), alone), 0, atol=1e-12)


def scattered(n: int = 300) -> np.ndarray:
    return np.random.default_rng(3).uniform(-1, 1, (n, 3)) * (0.6, 0.4, 0.6)


def test_a_motion_by_the_root_of_a_preconditioner_moves_the_picture_by_its_longer_side():
    """In each direction, but for the damping, which holds back what hardly shows: checked by projecting the points."""
    cameras, points, step = tiny_data.cameras(), scattered(), 1e-4
    for k, (camera, matrix) in enumerate(zip(cameras, preconditioners(cameras, points, EXTENT), strict=True)):
        moves = []
        sizes, directions = np.linalg.eigh(matrix)
        for size, direction in zip(sizes, directions.T, strict=True):
            motion = step * np.sqrt(size) * direction
            moved = replace(camera, w2c=moved_w2c(GIVEN[k][None], motion[None], EXTENT)[0])
            (before, _), (after, _) = camera.project(points), moved.project(points)
            seen = ((before > 0) & (before < (camera.width, camera.height))).all(axis=1)
            away = ((after - before)[seen] ** 2).sum(axis=1).mean()
            moves.append(np.sqrt(away) / camera.width / step)
        assert max(moves) == pytest.approx(1, abs=0.1) and sorted(moves)[2] > 0.3 and max(moves) < 1.001


def test_preconditioners_are_damped_inverses_of_what_differences_of_projected_points_say():
    cameras, points, step = tiny_data.cameras()[:3], scattered(), 1e-5
    for k, (camera, matrix) in enumerate(zip(cameras, preconditioners(cameras, points, EXTENT), strict=True)):

        def pixels(motion, k=k, camera=camera):
            return replace(camera, w2c=moved_w2c(GIVEN[k][None], motion[None], EXTENT)[0]).project(points)[0]

        seen = ((pixels(np.zeros(6)) > 0) & (pixels(np.zeros(6)) < (camera.width, camera.height))).all(axis=1)
        J = np.stack([(pixels(one) - pixels(-one))[seen] for one in step * np.eye(6)]) / (2 * step) / camera.width
        expected = np.einsum("ipc,jpc->ij", J, J) / seen.sum()  # [6, 6]
        expected *= 1 + DAMPING * np.eye(6)
        np.testing.assert_allclose(np.linalg.inv(matrix), expected, atol=1e-6 * expected.max())


def test_preconditioners_depend_neither_on_the_unit_of_the_world_nor_on_pixels():
    cameras, points = tiny_data.cameras(), scattered()
    larger = []
    for camera in cameras:
        w2c = np.array(camera.w2c)
        w2c[:3, 3] *= 7
        larger.append(replace(camera, w2c=w2c))
    expected = preconditioners(cameras, points, EXTENT)
    np.testing.assert_allclose(preconditioners(larger, 7 * points, 7 * EXTENT), expected, rtol=1e-9)
    finer = [camera.resized(480, 360) for camera in cameras]
    np.testing.assert_allclose(preconditioners(finer, points, EXTENT), expected, rtol=1e-9)


def test_many_points_count_as_few_that_lie_alike():
    """They are summed in blocks."""
    cameras, points = tiny_data.cameras(), scattered()
    many = np.tile(points, (BLOCK // 100, 1))  # three blocks
    assert 2 * BLOCK < len(many) < 3 * BLOCK
    expected = preconditioners(cameras, points, EXTENT)
    np.testing.assert_allclose(preconditioners(cameras, many, EXTENT), expected, rtol=1e-8)
    outside = np.concatenate([np.full((BLOCK, 3), [0, 0, 50.0]), points])  # a block of which nothing is seen
    np.testing.assert_allclose(preconditioners(cameras, outside, EXTENT), expected, rtol=1e-8)


def test_a_camera_that_sees_nothing_has_the_steps_of_the_others_and_all_of_them_steps():
    cameras, points = tiny_data.cameras(), scattered()
    blind = [replace(cameras[0], w2c=np.diag([-1.0, 1, -1, 1]) @ cameras[0].w2c), *cameras[1:]]
    got = preconditioners(blind, points, EXTENT)
    np.testing.assert_allclose(got[1:], preconditioners(cameras, points, EXTENT)[1:])
    others = np.linalg.inv(got[1:]).mean(axis=0)
    np.testing.assert_allclose(np.linalg.inv(got[0]), others, atol=1e-6 * others.max())
    assert np.isfinite(preconditioners(blind, np.zeros((0, 3)), EXTENT)).all()


def test_points_before_the_near_plane_are_not_seen():
    """One of them, right before a camera, would leave it hardly a shift."""
    cameras, points = tiny_data.cameras()[:1], scattered()
    before = cameras[0].position + 0.01 * cameras[0].w2c[2, :3]
    more, expected = np.concatenate([points, before[None]]), preconditioners(cameras, points, EXTENT)
    np.testing.assert_allclose(preconditioners(cameras, more, EXTENT, 0.02), expected, rtol=1e-9)
    assert preconditioners(cameras, more, EXTENT, 0.005)[0, 3, 3] < 0.1 * expected[0, 3, 3]
