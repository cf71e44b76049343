"""Starting models: scales from neighbours, and random primitives where the cameras look."""

import numpy as np
import pytest
from mi_dogsplat.datasets import View, camera_extent
from mi_dogsplat.scene.cameras import Camera, affine, spread_of
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.training import initialize
from mi_dogsplat.training.initialize import MIN_SQUARED_DISTANCE, random_splats, region_of_interest, splats_from_points
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]


def look_at(position, target, width=64, height=48, focal=50.0) -> Camera:
    forward = np.subtract(target, position) / np.linalg.norm(np.subtract(target, position))
    right = np.cross(forward, (0.0, 0.3, 1.0))
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward])
    return Camera(affine(turn, -turn @ position), focal, focal, width / 2, height / 2, width, height)


def ring(target, radius=4.0, count=12) -> list[Camera]:
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return [look_at(target + radius * np.array([np.cos(a), np.sin(a), 0.4]), target) for a in angles]


def test_scales_are_the_rms_distance_to_the_three_nearest_neighbours():
    rng = np.random.default_rng(0)
    points, colors = rng.normal(size=(60, 3)), rng.uniform(size=(60, 3))
    splats = splats_from_points(points, colors, sh_degree=2)

    squared = np.square(points[:, None] - points[None]).sum(-1)
    expected = np.sqrt(np.sort(squared, axis=1)[:, 1:4].mean(1))
    np.testing.assert_allclose(splats.scales, expected[:, None].repeat(3, 1), rtol=1e-5)
    np.testing.assert_allclose(splats.opacities, 0.1, rtol=1e-6)
    np.testing.assert_allclose(0.5 + C0 * splats.sh_coeffs[:, 0], colors, atol=1e-6)
    assert splats.sh_degree == 2 and not splats.sh_coeffs[:, 1:].any()
    np.testing.assert_array_equal(splats.quats, np.tile([0, 0, 0, 1], (60, 1)))


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4])
def test_few_points_use_the_neighbours_there_are(count):
    points = np.arange(3 * count, dtype=float).reshape(-1, 3)  # neighbours are sqrt(27) apart
    splats = splats_from_points(points, np.full((count, 3), 0.5), sh_degree=0)
    assert splats.n_splats == count and np.isfinite(splats.log_scales).all()
    if count == 1:
        np.testing.assert_array_equal(splats.scales, 1.0)
    if count == 2:
        np.testing.assert_allclose(splats.scales, np.sqrt(27), rtol=1e-6)


def test_coincident_points_get_the_smallest_scale():
    splats = splats_from_points(np.zeros((9, 3)), np.zeros((9, 3)), sh_degree=0)
    np.testing.assert_allclose(splats.scales, np.sqrt(MIN_SQUARED_DISTANCE), rtol=1e-5)


@pytest.mark.parametrize("size", [1.0, 0.3, 0.05])
def test_points_of_few_places_have_the_neighbours_that_brute_force_finds_by_a_tree_of_places(monkeypatch, size):
    """A tree of all points takes minutes for 150,000 in one place, as failed points of a capture are."""
    planted = []
    monkeypatch.setattr(initialize, "cKDTree", lambda places: planted.append(len(places)) or cKDTree(places))
    points = np.round(size * np.random.default_rng(1).normal(size=(80, 3)), 1 if size < 0.1 else 0)
    splats = splats_from_points(points, np.full((80, 3), 0.5), sh_degree=0)
    nearest = np.sort(np.square(points[:, None] - points[None]).sum(-1), axis=1)[:, 1:4].mean(1)
    expected = np.sqrt(np.maximum(nearest, MIN_SQUARED_DISTANCE))
    np.testing.assert_allclose(splats.scales, expected[:, None].repeat(3, 1), rtol=1e-5)
    assert planted == [len(set(map(tuple, points.tolist())))] and planted[0] < 80


def test_points_that_are_not_finite_are_left_out():
    points = np.array([[0, 0, 0], [np.nan, 0, 0], [1, 0, 0], [0, np.inf, 0]])
    np.testing.assert_array_equal(splats_from_points(points, np.zeros((4, 3)), 0).means, points[[0, 2]])


def test_a_missing_color_is_named():
    with pytest.raises(ValueError, match=r"points \(4, 3\) and colors \(3, 3\)"):
        splats_from_points(np.zeros((4, 3)), np.zeros((3, 3)), 0)


def test_inward_looking_cameras_are_interested_in_what_they_surround():
    target = np.array([3.0, -2.0, 1.0])
    centre, half = region_of_interest(ring(target))
    np.testing.assert_allclose(centre, target, atol=1e-9)
    assert half == pytest.approx(np.hypot(4, 1.6) * 64 / 2 / 50)  # distance times tangent of the half angle


def test_one_straying_camera_moves_the_region_little():
    target = np.array([3.0, -2.0, 1.0])
    stray = look_at(target + 4.0, target + (4.0, 4.0, 30.0))
    centre, _ = region_of_interest([*ring(target, count=30), stray])
    assert np.linalg.norm(centre - target) < 0.5


@pytest.mark.parametrize(
    "cameras",
    [
        [look_at((x, 0.0, 0.0), (x, 9.0, 0.0)) for x in (-1.0, 0.0, 2.0)],  # parallel
        [look_at((x, 0.0, 0.0), (3 * x, 9.0, 0.0)) for x in (-1.0, 0.0, 2.0)],  # their axes meet behind them
        [look_at((0.0, 0.0, 0.0), (0.0, 9.0, 0.0))],
        [look_at((3.1, 0.2, 0.7), (3.1 + x, 9.0, 0.7)) for x in (-1.0, 0.1, 2.0)],  # at one place up to rounding
    ],
    ids=["parallel", "diverging", "single", "turning"],
)
def test_where_axes_do_not_meet_the_region_lies_in_front(cameras):
    centre, half = region_of_interest(cameras)
    assert half > 0.1 and all(camera.project(centre)[1][0] > 0 for camera in cameras)


def test_cameras_that_turn_on_the_spot_have_no_spread_however_their_positions_are_rounded():
    turning = [look_at((3.1, 0.2, 0.7), (3.1 + x, 9.0 - x, 0.7 + x)) for x in np.linspace(-2, 2, 9)]
    positions = np.array([camera.position for camera in turning])
    assert 0 < np.ptp(positions, axis=0).max() < 1e-14 and spread_of(turning) == 0
    views = [View(str(k), camera, np.zeros((1, 1, 3))) for k, camera in enumerate(turning)]
    assert camera_extent(views) == 1
    assert spread_of([turning[0], look_at((3.1, 0.2, 0.7 + 1e-6), (3.0, 9.0, 0.7))]) == pytest.approx(5e-7)


@pytest.mark.parametrize(
    "cameras",
    [
        ring(np.array([3.0, -2.0, 1.0])),
        [look_at((x, 0.0, 0.0), (x, 9.0, 0.0)) for x in (-1.0, 0.0, 2.0)],
        [look_at((0.0, 0.0, 0.0), (0.0, 9.0, 0.0))],
        [look_at((0.1 * a, 0.1 * b, 0.0), (5.0 * a, 5.0 * b, 0.0)) for a in (-1, 1) for b in (-1, 1)],
    ],
    ids=["ring", "parallel", "single", "look-around"],
)
def test_random_primitives_are_where_cameras_look(cameras):
    splats = random_splats(cameras, 500, np.random.default_rng(3), sh_degree=1)
    assert splats.n_splats == 500 and np.isfinite(splats.log_scales).all()
    votes = np.zeros(500)
    for camera in cameras:
        pixels, depth = camera.project(splats.means)
        votes += ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(1) & (depth > 0)
    assert np.mean(votes >= 1) > 0.99
    assert np.mean(votes >= votes.max() / 2) > 0.99
    colors = 0.5 + C0 * splats.sh_coeffs[:, 0]
    assert colors.min() >= 0.399 and colors.max() <= 0.601


def test_random_primitives_repeat_with_the_seed():
    a, b, c = (random_splats(ring(np.zeros(3)), 50, np.random.default_rng(s), 0).means for s in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)
