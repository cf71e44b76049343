"""Signed distances of fused depth pictures, against a loop over voxels and views in float64."""

import numpy as np
import pytest
from mi_dogsplat.meshing.blocks import SIDE, BlockFinder
from mi_dogsplat.meshing.fusion import Fusion
from mi_dogsplat.scene.cameras import Camera, affine
from scipy.spatial.transform import Rotation
from splat_scenes import make_camera, tilted_camera

TRUNCATION, NEAR = 0.3, 0.4


def cameras() -> list[Camera]:
    """Three, of which the last stands among the voxels."""
    turned = affine(Rotation.from_euler("xyz", [0.2, -0.4, 0.3]).as_matrix(), (0.1, 0.2, -0.5))
    return [tilted_camera(31, 23, 25.0), make_camera(16, 20, 18.0, 7.3, 11.1, turned), make_camera(
        20, 20, 12.0, w2c=affine(np.eye(3), (0, 0, -3.9)))]  # fmt: skip


def depth_pictures(rng) -> list[np.ndarray]:
    """Of no scene: some depth in each pixel, and some pixels without."""
    pictures = [rng.uniform(2, 5, (camera.height, camera.width)).astype(np.float32) for camera in cameras()]
    for picture in pictures:
        picture[rng.uniform(size=picture.shape) < 0.2] = 0
    return pictures


def expected_distance(point: np.ndarray, pictures: list[np.ndarray], least: float) -> tuple[float, int, bool]:
    """(mean distance, number of views that tell one, whether float32 must agree)."""
    sum_, count, clear = 0.0, 0, True
    for camera, picture in zip(cameras(), pictures, strict=True):
        x, y, z = camera.w2c[:3, :3] @ point + camera.w2c[:3, 3]
        clear &= abs(z - least) > 1e-4
        if z <= least:
            continue
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        clear &= abs(u - round(u)) > 1e-3 and abs(v - round(v)) > 1e-3
        if not (0 <= u < camera.width and 0 <= v < camera.height):
            continue
        depth = picture[int(v), int(u)]
        distance = (depth - z) / TRUNCATION if depth else 1
        clear &= abs(distance + 1) > 1e-4
        if distance >= -1:
            sum_, count = sum_ + min(distance, 1), count + 1
    return sum_ / max(count, 1), count, clear


@pytest.mark.parametrize("near", [NEAR, 1.5])
def test_distances_are_those_of_the_loop(near):
    rng = np.random.default_rng(3)
    pictures = depth_pictures(rng)
    finder = BlockFinder(np.array([0.1, 0.0, 3.5]), 0.11, 0.4)
    finder.add(rng.uniform([-1, -1, 2.5], [1, 1, 4.5], (12, 3)))
    blocks = finder.blocks()
    fusion = Fusion(blocks, TRUNCATION)
    for camera, picture in zip(cameras(), pictures, strict=True):
        fusion.add(camera, picture, near)
    distances = [fusion.distances(least) for least in (1, 2, 3)]
    assert {values.shape for values in distances} == {(len(blocks.keys), SIDE, SIDE, SIDE)}
    checked = set()
    for row, place in [(k, rng.integers(0, SIDE, 3)) for k in range(len(blocks.keys)) for _ in range(12)]:
        point = blocks.corners[row] + blocks.voxel * place
        mean, count, clear = expected_distance(point, pictures, near)
        if clear:
            for least, values in enumerate(distances, start=1):
                expected = mean if count >= least else np.nan
                assert values[row][tuple(place)] == pytest.approx(expected, abs=1e-4, nan_ok=True)
            checked.add(count)
    assert checked == {0, 1, 2, 3} if near == NEAR else {0, 1, 2} <= checked


def test_far_from_the_origin_the_distances_are_the_same():
    """Blocks are brought into camera space in float64."""
    found = []
    for offset in (np.zeros(3), np.array([4e5, -3e5, 2e5])):
        camera = tilted_camera(31, 23, 25.0)
        w2c = camera.w2c.copy()
        w2c[:3, 3] -= w2c[:3, :3] @ offset
        moved = Camera(w2c, camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
        finder = BlockFinder(offset + (0, 0, 3), 0.1, 0.4)
        finder.add(offset + np.array([[0.0, 0, 3], [0.5, 0.3, 3.5]]))
        fusion = Fusion(finder.blocks(), TRUNCATION)
        fusion.add(moved, np.full((23, 31), 3.1, np.float32), NEAR)
        found.append(fusion.distances())
    np.testing.assert_allclose(found[1], found[0], atol=1e-5)


def test_of_no_blocks_there_are_no_distances():
    fusion = Fusion(BlockFinder(np.zeros(3), 0.1, 0.4).blocks(), TRUNCATION)
    fusion.add(make_camera(8, 6), np.ones((6, 8), np.float32), NEAR)
    assert fusion.distances(2).shape == (0, SIDE, SIDE, SIDE)


def test_a_view_that_sees_no_block_changes_nothing():
    finder = BlockFinder(np.zeros(3), 0.1, 0.4)
    finder.add(np.zeros((1, 3)))
    fusion = Fusion(finder.blocks(), TRUNCATION)
    away = make_camera(w2c=affine(np.eye(3), (0, 0, -9)))
    fusion.add(away, np.full((away.height, away.width), 2, np.float32), NEAR)
    assert np.isnan(fusion.distances()).all()
