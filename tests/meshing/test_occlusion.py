"""Blocks behind the surface of a view: none that a view says something of, and most of the others."""

import numpy as np
import pytest
from mi_dogsplat.meshing.blocks import Blocks, keys_of
from mi_dogsplat.meshing.fusion import Fusion
from mi_dogsplat.meshing.occlusion import hidden
from mi_dogsplat.scene.cameras import Camera, affine
from scipy.spatial.transform import Rotation
from splat_scenes import make_camera, tilted_camera

TRUNCATION = 0.1


def spheres(camera: Camera, n: int = 300) -> np.ndarray:
    """[n, 3] middles in camera space, in the picture or across its border."""
    rng = np.random.default_rng(2)
    z = rng.uniform(0.05, 6, n)
    u = rng.uniform(-0.2, 1.2, (n, 2)) * (camera.width, camera.height)
    return np.column_stack([(u[:, 0] - camera.cx) / camera.fx * z, (u[:, 1] - camera.cy) / camera.fy * z, z])


def behind(camera: Camera, depth: np.ndarray, middle: np.ndarray, radius: float) -> bool:
    """Whether all of many points of a sphere are hidden that are in the picture; some are."""
    steps = np.random.default_rng(3).normal(size=(2000, 3))
    points = middle + radius * steps / np.linalg.norm(steps, axis=1, keepdims=True)
    x, y, z = points[points[:, 2] > 0].T
    column, row = np.floor(camera.fx * x / z + camera.cx), np.floor(camera.fy * y / z + camera.cy)
    inside = (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
    seen = depth[row[inside].astype(int), column[inside].astype(int)]
    return bool(((seen > 0) & (z[inside] > seen + TRUNCATION)).all()) and (points[:, 2] > 0).all()


@pytest.mark.parametrize("camera", [make_camera(), tilted_camera(31, 23, 25.0), make_camera(97, 130, 300.0, 20, 110)])
@pytest.mark.parametrize("radius", [0.02, 0.3])
@pytest.mark.parametrize("holes", [0.0, 0.002])
def test_what_is_hidden_lies_behind_all_pixels_that_it_may_be_in(camera, radius, holes):
    rng = np.random.default_rng(1)
    lines, columns = np.indices((camera.height, camera.width))
    depth = 2 + np.sin(columns / 19) + 0.5 * np.cos(lines / 7)
    depth[rng.uniform(size=depth.shape) < holes] = 0
    middles = spheres(camera)
    found = hidden(camera, depth.astype(np.float32), middles, radius, TRUNCATION)
    brute = np.array([behind(camera, depth, middle, radius) for middle in middles])
    assert not (found & ~brute).any()
    if not holes:  # one in a large tile, and it tells nothing
        assert found.sum() > 0.6 * brute.sum()  # .67 to .86 here; looked up in tiles that are too large, from .55 on


CENTRE = np.array([0.1, 0.0, 3.5])
BACK = Rotation.align_vectors([[0, 0, -1], [1, 0, 0]], [[1, 1, 1], [1, -1, 0]])[0].as_matrix()  # blocks begin far away


@pytest.mark.parametrize(
    "camera", [tilted_camera(64, 48, 50.0), make_camera(64, 48, 50.0, w2c=affine(BACK, (0, 0, 3.5) - BACK @ CENTRE))]
)
def test_sums_are_the_same_with_and_without(monkeypatch, camera):
    blocks = Blocks(CENTRE, 0.03, np.unique(keys_of(np.array(list(np.ndindex(9, 9, 9))) - 4)))
    lines, columns = np.indices((48, 64))
    depth = (3 + 0.3 * np.sin(columns / 9) + 0.2 * np.cos(lines / 7)).astype(np.float32)
    found = []
    for _ in range(2):
        fusion = Fusion(blocks, TRUNCATION)
        fusion.add(camera, depth, 0.2)
        found.append(fusion.distances())
        monkeypatch.setattr("mi_dogsplat.meshing.fusion.hidden", lambda *a: np.zeros(len(a[2]), bool))
    np.testing.assert_array_equal(*found)
    assert np.isfinite(found[0]).any()
