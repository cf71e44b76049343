"""Points of depth maps: where pixels say that they are, evenly spread, and none between two surfaces."""

from collections import defaultdict

import numpy as np
import pytest
from mi_dogsplat.datasets import depth_points as module
from mi_dogsplat.datasets.depth_points import depth_points, far_from, seen_through, steady, thinned
from mi_dogsplat.scene.cameras import Camera, affine

W2C = np.array([[0, -1, 0, 0.3], [1, 0, 0, -0.2], [0, 0, 1, 0.5], [0, 0, 0, 1.0]])
CAMERA = Camera(W2C, 40, 50, 17, 11, 32, 24)


def test_points_are_where_single_pixels_see_them():
    """The map is half as large as the image."""
    depth = np.zeros((12, 16))
    depth[3, 5], depth[9, 10] = 2, 3
    image = np.random.default_rng(0).random((24, 32, 3)).astype(np.float32)
    points, colors = depth_points([(CAMERA, depth, image)], 1)
    assert points.dtype == colors.dtype == np.float32
    expected = []
    for row, column in ((3, 5), (9, 10)):
        z = depth[row, column]
        local = np.array([(2 * (column + 0.5) - 17) / 40 * z, (2 * (row + 0.5) - 11) / 50 * z, z])
        expected.append([*np.linalg.solve(W2C, [*local, 1])[:3], *image[2 * row + 1, 2 * column + 1]])
    found = np.concatenate([points, colors], axis=1)
    np.testing.assert_allclose(sorted(found.tolist()), sorted(map(list, expected)), rtol=1e-5)


def test_without_depths_there_are_no_points():
    points, colors = depth_points([(CAMERA, np.zeros((4, 4)), np.zeros((24, 32, 3)))], 1)
    assert points.shape == colors.shape == (0, 3)


def test_pixels_beside_a_jump_are_left_out_and_those_beside_unknown_ones_are_not():
    depth = np.full((6, 9), 2.0)
    depth[:, 4:] = 3
    depth[2, 1] = 0
    expected = np.ones((6, 9), bool)
    expected[:, 3:5] = False
    expected[2, 1] = False
    np.testing.assert_array_equal(steady(depth), expected)
    np.testing.assert_array_equal(steady(depth.T), expected.T)


def test_a_slope_is_steady():
    assert steady(np.broadcast_to(np.linspace(2, 2.5, 20), (5, 20))).all()


def test_thinned_points_are_the_means_of_cells_and_no_more_than_asked_for():
    rng = np.random.default_rng(3)
    points, colors = rng.random((4000, 3)) * [1, 2, 0.5], rng.random((4000, 3))
    found, of_cells = thinned(points, colors, 300)
    assert 200 < len(found) <= 300
    offsets = points - points.min(axis=0)
    sizes = [s for s in np.linspace(0.1, 0.3, 2001) if len({tuple(c) for c in offsets // s}) == len(found)]
    assert sizes
    for size in sizes:  # by brute force, for one of the sizes that give so many cells
        cells = defaultdict(list)
        for row, cell in enumerate(offsets // size):
            cells[tuple(cell)].append(row)
        means = sorted(tuple(points[rows].mean(axis=0)) + tuple(colors[rows].mean(axis=0)) for rows in cells.values())
        if np.allclose(means, sorted(map(tuple, np.concatenate([found, of_cells], axis=1))), atol=1e-9):
            return
    pytest.fail("no grid has these means")


def test_points_that_other_views_see_through_are_left_out():
    """Three cameras before a wall; the map of the first has something in front of it that is not there."""
    cameras = [Camera(affine(np.eye(3), (-x, 0, 0)), 40, 40, 16, 12, 32, 24) for x in (0, 0.5, 1)]
    wall = np.full((24, 32), 3.0)
    wrong = wall.copy()
    wrong[8:12, 20:26] = 2
    image = np.zeros((24, 32, 3))
    points, _ = depth_points(zip(cameras, (wrong, wall, wall), 3 * [image], strict=True), 3)
    np.testing.assert_allclose(points[:, 2], 3)
    alone, _ = depth_points([(cameras[0], wrong, image)], 1)
    assert (alone[:, 2] == 2).any()  # nobody denies it
    behind = np.array([[0.0, 0, 5]])
    assert not seen_through(behind, [(camera, wall) for camera in cameras])
    beside = np.array([[0.0, 0, -1], [9, 0, 1], [0, 0, 1]])
    np.testing.assert_array_equal(seen_through(beside, [(cameras[0], wall)]), [False, False, True])
    assert not seen_through(beside, [(cameras[0], 0 * wall)]).any()


def test_points_beside_others_are_not_far_from_them():
    points = np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0), [0]), axis=-1).reshape(-1, 3)
    others = np.array([[0.2, 0.1, 0], [3, 3, 0.9], [50, 50, 50]])
    near = {(0, 0, 0), (1, 0, 0), (0, 1, 0), (3, 3, 0)}
    expected = [tuple(point) not in near for point in points]
    expected = [e or np.linalg.norm(others - p, axis=1).min() > 1 for e, p in zip(expected, points, strict=True)]
    np.testing.assert_array_equal(far_from(points, others), expected)
    assert far_from(points, np.zeros((0, 3))).all() and far_from(points[:1], others).all()
    assert not far_from(points, points).any()


@pytest.mark.parametrize("spread", [0, 1e-9, 1e9])
def test_points_at_one_place_and_one_far_away_are_thinned(spread):
    points = np.zeros((50, 3))
    points[0] = spread
    found, _ = thinned(points, np.zeros((50, 3)), 10)
    assert len(found) == (2 if spread else 1)


def test_pixels_are_taken_of_all_views_alike(monkeypatch):
    monkeypatch.setattr(module, "MOST", 40)
    depth = np.full((24, 32), 2.0)
    views = [(Camera(np.eye(4), 40, 40, 16, 12, 32, 24), depth, np.full((24, 32, 3), k / 2)) for k in range(2)]
    points, colors = depth_points(views, 2)
    assert 20 < len(points) <= 40
    assert 0.2 < colors.mean() < 0.3
