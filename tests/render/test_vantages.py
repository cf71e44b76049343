"""Cameras around and inside a model: they see it, they stand in the open, and other seeds stand elsewhere."""

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.render.framing import likely_up, robust_sphere
from mi_dogsplat.render.vantages import CLEARANCE, DEVIATIONS, REACH, cameras_inside, cameras_outside, vantage_cameras
from mi_dogsplat.scene.splats import Splats
from splat_scenes import make_splats, rounded

SIZE = (40, 30)


def room(n=3000, seed=0) -> Splats:
    """The walls of a box, and a floor that is denser, so that up is told."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (n, 3))
    axis = rng.integers(0, 3, n)
    points[np.arange(n), axis] = np.sign(points[np.arange(n), axis])
    return rounded(make_splats(points, [0.03, 0.03, 0.01], 0.9))


def test_cameras_inside_a_room_stand_in_the_open_and_look_at_its_walls():
    """Oracle: distances to all primitives."""
    splats = room()
    centre, radius = robust_sphere(splats)
    found = cameras_inside(splats, 10, SIZE, np.random.default_rng(1), likely_up(splats))
    assert len(found) == 10
    for camera in found:
        clear = np.linalg.norm(splats.means - camera.position, axis=1) - DEVIATIONS * splats.scales.max(axis=1)
        assert clear.min() > CLEARANCE * radius
        pixels, depths = camera.project(splats.means)
        nearest = abs(pixels[depths > 0] - (20, 15)).max(axis=1).min()
        assert nearest < 0.5, "a primitive in the middle of the picture"
    assert sum(np.all(abs(camera.position) < 1) for camera in found) >= 5


def test_cameras_around_frame_the_model_from_all_sides():
    splats = tiny_data.truth()
    centre, radius = robust_sphere(splats)
    found = cameras_outside(splats, 24, SIZE, np.random.default_rng(0), likely_up(splats))
    assert len(found) == 24
    offsets = np.array([camera.position - centre for camera in found])
    core = splats.means[np.linalg.norm(splats.means - centre, axis=1) < 0.9 * radius]
    for camera in found:
        pixels, depths = camera.project(core)
        assert (depths > 0).all() and ((pixels >= 0) & (pixels <= SIZE)).all()
    distances = np.linalg.norm(offsets, axis=1)
    assert distances == pytest.approx(np.full(24, distances[0]))
    heights = offsets @ likely_up(splats) / distances
    assert heights.min() < -0.4 and heights.max() > 0.9


def test_where_nothing_is_free_all_cameras_are_around(monkeypatch):
    monkeypatch.setattr("mi_dogsplat.render.vantages.REACH", 0.5)
    assert len(vantage_cameras(room(), 12, SIZE)) == 12
    solid = rounded(make_splats(np.random.default_rng(0).uniform(-1, 1, (4000, 3)), 0.1, 0.9))
    assert not cameras_inside(solid, 6, SIZE, np.random.default_rng(0), likely_up(solid))
    outside = vantage_cameras(solid, 12, SIZE)
    assert len(outside) == 12
    assert len({round(float(np.linalg.norm(c.position)), 1) for c in outside}) <= 2


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_a_share_of_them_is_inside(share):
    centre, radius = robust_sphere(room())
    found = vantage_cameras(room(), 8, SIZE, share_inside=share)
    near = [np.linalg.norm(camera.position - centre) <= REACH * radius for camera in found]
    assert len(found) == 8 and sum(near) == 8 * share


def test_a_seed_gives_its_cameras_and_another_one_others():
    splats = room()
    one, same, other = (vantage_cameras(splats, 8, SIZE, seed) for seed in (0, 0, 1))
    for a, b, c in zip(one, same, other, strict=True):
        assert np.array_equal(a.w2c, b.w2c) and not np.allclose(a.w2c, c.w2c, atol=1e-3)


@pytest.mark.parametrize("log_scale", [89.0, 300.0])
def test_a_primitive_larger_than_any_number_is_no_error(log_scale):
    splats = room()
    splats.log_scales[7] = log_scale
    assert len(vantage_cameras(splats, 8, SIZE)) == 8


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_model_of_few_primitives_is_seen(n):
    splats = rounded(make_splats(np.random.default_rng(n).uniform(-1, 1, (n, 3)), 0.01, 0.9))
    assert len(vantage_cameras(splats, 6, SIZE)) == 6
