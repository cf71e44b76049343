"""Which way is up: its names, what cameras tell of it, and a model set upright."""

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.datasets.camera_paths import hemisphere, look_at
from mi_dogsplat.render.framing import automatic_camera
from mi_dogsplat.render.vantages import vantage_cameras
from mi_dogsplat.scene.cameras import inverse_rigid
from mi_dogsplat.scene.drawing import Drawing, comments_of, drawing_of, drawing_of_extras
from mi_dogsplat.scene.orientation import AXES, placement, roll, up_name, up_of_cameras, up_vector

TILTED = "0.36,-0.8,0.48"


@pytest.mark.parametrize("name", [*AXES, TILTED, "-1,0,0.1"])
def test_a_direction_has_a_name(name):
    again = up_vector(up_name(up_vector(name)))
    assert np.linalg.norm(again) == pytest.approx(1)
    np.testing.assert_allclose(again, up_vector(name), atol=1e-6)


@pytest.mark.parametrize("name", ["up", "", "1,2", "0,0,0", "nan,0,1", "1e400,0,0", "--y", "1,2,3,4"])
def test_what_is_none_is_refused_and_passed_over_in_files(name):
    with pytest.raises(ValueError, match="is not a direction"):
        up_vector(name)
    assert drawing_of([f"dogsplat up {name}"]).up is None
    assert drawing_of_extras({"dogsplat": {"up": [0, 1, 0]}}).up is None


def test_what_is_near_to_an_axis_has_its_name():
    assert up_name(np.array([0.02, -1, 0.02])) == "-y" and "," in up_name(np.array([0.1, -1, 0]))


def test_a_direction_travels_in_the_header_of_a_file():
    drawing = Drawing(up=TILTED, scale=0.25)
    assert drawing_of(comments_of(drawing)) == drawing
    assert "dogsplat up 0.36,-0.8,0.48" in comments_of(drawing)


def cameras_about(up: np.ndarray, positions: np.ndarray) -> np.ndarray:
    return np.stack([inverse_rigid(look_at(p, np.zeros(3), up)) for p in positions])


@pytest.mark.parametrize("elevations", [(0.0, 60.0), (80.0, 88.0), (-60.0, -20.0)])
def test_level_cameras_tell_up_exactly(elevations):
    """From below, from all sides, and straight from above, where their pictures are hardly upright."""
    for sign in (1, -1):  # an axis that is found by squares has no sign of its own
        up = sign * up_vector(TILTED)
        found = cameras_about(up, sign * 3 * hemisphere(30, TILTED, elevations))
        assert np.degrees(np.arccos(min(up_of_cameras(found) @ up, 1.0))) < 0.2  # rounded, it may be above 1
        assert roll(found, up_of_cameras(found)) < 2e-3


@pytest.mark.parametrize("ahead", [-1, 1])
def test_cameras_that_look_straight_down_tell_up_by_where_they_look(ahead):
    """A drone that turns about its view: no picture is more upright than another."""
    angles = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    c2w = np.repeat(np.eye(4)[None], 12, axis=0)
    c2w[:, :3, 0] = np.stack([np.cos(angles), np.sin(angles), 0 * angles], -1)
    c2w[:, :3, 2] = (0, 0, ahead)
    c2w[:, :3, 1] = np.cross(c2w[:, :3, 2], c2w[:, :3, 0])
    np.testing.assert_allclose(up_of_cameras(c2w), [0, 0, -ahead], atol=1e-6)


def test_cameras_held_anyhow_roll():
    rng = np.random.default_rng(0)
    c2w = np.repeat(np.eye(4)[None], 40, axis=0)
    c2w[:, :3, :3] = np.linalg.qr(rng.normal(size=(40, 3, 3)))[0]
    assert roll(c2w, up_of_cameras(c2w)) > 0.35


@pytest.mark.parametrize(("up", "scale"), [("z", None), (TILTED, 2.5), (None, 0.5), ("-y", None)])
def test_a_placement_sets_upright_and_scales(up, scale):
    matrix, factor = placement(up, scale), scale or 1
    expected = factor * np.array([0, -1, 0])
    np.testing.assert_allclose(matrix[:3, :3] @ up_vector(up or "-y"), expected, atol=1e-12)
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, factor**2 * np.eye(3), atol=1e-12)


def test_views_of_a_model_stand_upright_by_what_it_says():
    model, up = tiny_data.truth(), up_vector(TILTED)
    camera = automatic_camera(model, TILTED)
    assert abs(camera.w2c[0, :3] @ up) < 1e-9 and camera.w2c[1, :3] @ up < -0.8
    for found in vantage_cameras(model, 6, (20, 20), up_axis=TILTED):
        assert abs(found.w2c[0, :3] @ up) < 1e-6
