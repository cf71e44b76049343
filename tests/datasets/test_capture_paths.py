"""Paths around a scene: where they run, and what they frame."""

import numpy as np
import pytest
from captured_scenes import sensor, write_scene
from mi_dogsplat.datasets.camera_paths import circling_shots, hemisphere, look_at, orbit
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.datasets.given_cameras import auto_up
from mi_dogsplat.datasets.scene_file import framing_sphere, load_scene
from mi_dogsplat.scene.orientation import up_vector


@pytest.mark.parametrize("place", [hemisphere, orbit])
@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_a_path_stays_in_its_band_goes_all_around_and_looks_at_the_centre_upright(place, up):
    directions = place(50, up, (10, 60))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    elevation = np.degrees(np.arcsin(directions @ up_vector(up)))
    assert 10 < elevation.min() < 12 and 58 < elevation.max() < 60
    level = directions - np.outer(directions @ up_vector(up), up_vector(up))
    assert np.linalg.norm(level.mean(axis=0)) < 0.08
    target = np.array([1.0, 2.0, 3.0])
    w2c = look_at(target + 5 * directions[7], target, up)
    np.testing.assert_allclose(w2c @ [*target, 1], [0, 0, 5, 1], atol=1e-12)
    assert np.linalg.det(w2c[:3, :3]) == pytest.approx(1)
    raised = w2c[:3, :3] @ up_vector(up)
    assert raised[0] == pytest.approx(0) and raised[1] < 0  # up in the world is up in the image


@pytest.mark.parametrize("up", ["z", "-y"])
def test_an_orbit_is_a_path_on_which_neighbours_are_near_and_turns_are_as_far_apart(up):
    n = 200
    directions = orbit(n, up, (0, 70))
    gaps = np.degrees(np.arccos(np.sum(directions[1:] * directions[:-1], axis=1)))
    assert gaps.max() < 1.2 * gaps.min()
    angles = np.degrees(np.arccos(np.clip(directions @ directions.T, -1, 1)))
    far_along = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) > 4
    to_other_turns = np.where(far_along, angles, np.inf).min(axis=1)
    assert np.median(to_other_turns) == pytest.approx(gaps.mean(), rel=0.25)
    assert (np.cross(directions[:-1], directions[1:]) @ up_vector(up) > 0).all()  # counter-clockwise from above
    hops = hemisphere(n, up, (0, 70))
    assert np.degrees(np.arccos(np.sum(hops[1:] * hops[:-1], axis=1))).min() > 3 * gaps.max()


def test_an_orbit_at_one_height_is_one_turn(tmp_path):
    directions = orbit(12, "z", (20, 20))
    np.testing.assert_allclose(np.degrees(np.arcsin(directions[:, 2])), 20)
    azimuth = np.degrees(np.unwrap(np.arctan2(directions[:, 1], directions[:, 0])))
    np.testing.assert_allclose(np.diff(azimuth), 30)
    narrow = orbit(12, "z", (20, 21))  # a spiral of equal areas would be an arc here
    azimuth = np.degrees(np.unwrap(np.arctan2(narrow[:, 1], narrow[:, 0])))
    np.testing.assert_allclose(np.diff(azimuth), 30, rtol=0.02)


@pytest.mark.parametrize("size", [(60, 40), (40, 60)])
def test_the_sphere_to_frame_just_fits_at_zoom_one(size):
    center = np.array([1.0, -2.0, 0.5])
    for zoom in (1.0, 2.0):
        (shot,) = circling_shots(CaptureConfig(size=size, fov=50, zoom=zoom), 1, center, 3.0, "z")
        camera = shot.camera
        np.testing.assert_allclose(camera.project([center])[0][0], (camera.cx, camera.cy))
        distance = np.linalg.norm(camera.position - center)
        tangent = 0.5 * min(size) / camera.fx  # of half the narrower angle
        assert 3.0 / distance == pytest.approx(zoom * np.sin(np.arctan(tangent)))
        assert 2 * np.degrees(np.arctan(0.5 * max(size) / camera.fx)) == pytest.approx(50)


LAMP = '<emitter type="area"/>'
ASIDE = '<translate x="10" z="9"/>'


def scaled(kind: str, scale: float, turn: str = "", more: str = "") -> str:
    """A shape larger than what stands in the middle."""
    return f'<shape type="{kind}"><transform name="to_world"><scale value="{scale}"/>{turn}</transform>{more}</shape>'


@pytest.mark.parametrize(
    ("others", "n_left_out"),
    [
        ([], 0),
        ([scaled("sphere", 90, more=LAMP)], 0),  # lamps never count
        ([scaled("rectangle", 90)], 1),
        ([scaled("disk", 40, '<translate z="-3"/>')], 1),
        ([scaled("rectangle", 90), scaled("rectangle", 80, '<rotate x="1" angle="90"/>')], 2),
        ([scaled("sphere", 50, ASIDE)], 1),  # a dome that is no lamp
        ([scaled("sphere", 50, ASIDE), scaled("rectangle", 30)], 2),
    ],
)
def test_floors_walls_domes_and_lamps_do_not_widen_the_frame(tmp_path, others, n_left_out):
    scene = load_scene(write_scene(tmp_path, *others, sensor("eye")))[0]
    center, radius, left_out = framing_sphere(tmp_path, scene)
    np.testing.assert_allclose(center, 0, atol=1e-6)
    assert radius == pytest.approx(np.linalg.norm([1.4, 1.1, 0.9])) and left_out == n_left_out


@pytest.mark.parametrize(
    "other",
    [
        scaled("sphere", 30, '<translate x="36"/>'),  # large, but no floor and no dome
        scaled("rectangle", 2),  # a table as large as what stands on it
    ],
)
def test_what_is_large_but_part_of_the_scene_is_framed_too(tmp_path, other):
    scene = load_scene(write_scene(tmp_path, other, sensor("eye")))[0]
    _, radius, left_out = framing_sphere(tmp_path, scene)
    assert left_out == 0 and radius > 2


def test_what_shines_is_framed_where_there_is_nothing_else(tmp_path):
    ball = '<shape type="sphere"><point name="center" x="1" y="2" z="3"/><emitter type="area"/></shape>'
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0"><integrator type="path"/>{ball}</scene>')
    center, radius, _ = framing_sphere(tmp_path, load_scene(tmp_path / "scene.xml")[0])
    np.testing.assert_allclose(center, (1, 2, 3))
    assert radius == pytest.approx(3**0.5)


@pytest.mark.parametrize(
    ("up", "origin", "expected"),
    [
        ("0, 0, 1", "3, -4, 2", "z"),
        ("0, 1, 0", "3, 1, 2", "y"),
        ("0, -1, 0", "3, 1, 2", "-y"),
        ("0, 0, 1", "0.5, -0.4, 9", "z"),  # steeply from above: the picture's vertical is nearly level
        ("0.1, 0.2, 1", "3, -4, 2", "z"),  # rolled
        (None, None, "z"),
    ],
)
def test_the_vertical_is_that_of_the_scenes_first_sensor(tmp_path, up, origin, expected):
    parts = [sensor("eye", origin or "").replace("0.1, 0.2, 1", up).replace("0.1, 0.2, 0", "0, 0, 0")] if up else []
    assert auto_up(load_scene(write_scene(tmp_path, *parts))[0]) == expected
