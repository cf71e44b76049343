"""Where the cameras of a capture stand: exactly where Mitsuba's sensors do, or around what there is to look at."""

import json
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from captured_scenes import sensor, write_scene
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.camera_paths import circling_shots, hemisphere, look_at, orbit
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.datasets.given_cameras import auto_up
from mi_dogsplat.datasets.scene_file import framing_sphere, load_scene
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.orientation import up_vector
from mi_dogsplat.support.errors import DataError

OFFSETS = '<float name="principal_point_offset_x" value="0.1"/><float name="principal_point_offset_y" value="-0.2"/>'
CROP = "".join(
    f'<integer name="crop_{name}" value="{value}"/>'
    for name, value in {"offset_x": 5, "offset_y": 3, "width": 20, "height": 24}.items()
)
TALL = '<float name="fov" value="40"/><string name="fov_axis" value="y"/>'
SENSORS = {  # what makes a sensor awkward to read, and its size in pixels
    "plain": (sensor("plain"), (40, 30)),
    "tall_angle": (sensor("tall_angle", extra=TALL), (40, 30)),
    "millimetres": (sensor("millimetres", extra='<string name="focal_length" value="35mm"/>'), (40, 30)),
    "shifted": (sensor("shifted", extra=OFFSETS), (40, 30)),
    "cropped": (sensor("cropped", extra=OFFSETS, film=CROP), (20, 24)),
    "far": (sensor("far", origin="300, -400, 200"), (40, 30)),
}


def mitsuba_rays(loaded: Any, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions float64 [H, W, 3] through the pixel centres, as the sensor itself samples them."""
    width, height = size
    across, down = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    film = mi.Point2f(np.array([across.ravel(), down.ravel()], np.float32))
    ray, _ = loaded.sample_ray(0.0, 0.5, film, mi.Point2f(0.5))
    near = np.array(ray.o, np.float64).T.reshape(height, width, 3)
    return near, np.array(ray.d, np.float64).T.reshape(height, width, 3)


def camera_rays(camera: Camera) -> np.ndarray:
    """Directions float64 [H, W, 3] through the pixel centres, written out from the conventions."""
    across, down = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    local = np.stack([(across - camera.cx) / camera.fx, (down - camera.cy) / camera.fy, np.ones_like(across)], -1)
    directions = local @ camera.w2c[:3, :3]
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


@pytest.fixture(scope="module")
def sensors(tmp_path_factory) -> tuple[Path, Path]:
    """(the scene, its capture)"""
    folder = tmp_path_factory.mktemp("sensors")
    mirrored = sensor("mirrored", last='<scale x="-1"/>', extra=OFFSETS)
    scene = write_scene(folder, *(xml for xml, _ in SENSORS.values()), mirrored)
    return scene, capture(scene, folder / "out", CaptureConfig(path="sensors", spp=16, points=100, test=0, alpha=True))


def one_view(data: Path, name: str):
    return next(view for view in load_dataset(data).views if view.name == name)


@pytest.mark.parametrize("name", SENSORS)
def test_cameras_read_back_see_along_the_rays_of_the_scenes_sensors(sensors, name):
    scene, data = sensors
    loaded = next(s for s in mi.load_file(str(scene)).sensors() if s.id() == name)
    camera = one_view(data, name).camera
    near, directions = mitsuba_rays(loaded, SENSORS[name][1])
    assert directions.shape == (camera.height, camera.width, 3)
    np.testing.assert_allclose(camera_rays(camera), directions, atol=1e-6)
    parameters: Any = mi.traverse(loaded)
    pose = np.array(parameters["to_world"].matrix, np.float64).reshape(4, 4)
    np.testing.assert_allclose(camera.position, pose[:3, 3], rtol=1e-6)
    np.testing.assert_allclose(camera.w2c[2, :3], pose[:3, 2], atol=1e-6)
    away = near - camera.position  # rays begin on the near plane
    np.testing.assert_allclose(np.cross(away, directions), 0, atol=1e-6 * np.abs(camera.position).max())


@pytest.mark.parametrize("name", [*sorted(SENSORS.keys() - {"far"}), "mirrored"])  # far away there are too few pixels
def test_pictures_are_those_of_the_sensors_and_that_of_a_mirrored_one_is_turned_back(sensors, name):
    scene, data = sensors
    loaded, _ = load_scene(scene, hide_emitters=True)
    own = next(s for s in loaded.sensors() if s.id() == name)
    mi.render(loaded, sensor=own, spp=64)
    alpha = np.array(own.film().bitmap())[..., 3]
    view = one_view(data, name)
    assert np.linalg.det(view.camera.w2c[:3, :3]) == pytest.approx(1)
    same, turned = (np.abs(view.image[..., 3] - a).mean() for a in (alpha, alpha[:, ::-1]))
    if name == "mirrored":
        same, turned = turned, same
    assert same < min(0.03, 0.3 * turned)


def test_sensors_keep_their_clipping_distances_and_shrink_when_asked(tmp_path):
    clip = '<float name="near_clip" value="5.3"/><float name="far_clip" value="5.6"/>'
    scene = write_scene(tmp_path, sensor("whole"), sensor("thin slice", extra=clip))
    config = CaptureConfig(path="sensors", spp=16, points=100, downscale=2, alpha=True, test=0)
    data = capture(scene, tmp_path / "out", config)
    whole, thin = (one_view(data, name) for name in ("whole", "thin_slice"))
    assert whole.image.shape == (15, 20, 4) and whole.camera.fx == thin.camera.fx
    assert 0 < thin.image[..., 3].mean() < 0.7 * whole.image[..., 3].mean()


@pytest.mark.parametrize(
    ("kind", "extra"),
    [
        ("orthographic", ""),
        ("thinlens", '<float name="aperture_radius" value="0.1"/><float name="focus_distance" value="4"/>'),
        ("irradiancemeter", None),
    ],
)
def test_other_sensors_are_refused_in_a_line_that_names_what_can_be_captured(tmp_path, kind, extra):
    if extra is None:  # a sensor on a shape
        film = '<film type="hdrfilm"><rfilter type="box"/></film>'
        other = f'<shape type="sphere"><sensor type="irradiancemeter" id="odd">{film}</sensor></shape>'
    else:
        other = sensor("odd", kind=kind, extra=extra)
    message = error_of(write_scene(tmp_path, sensor("good"), other), tmp_path / "out", CaptureConfig(path="sensors"))
    assert 'sensor "odd"' in message and "only perspective sensors" in message
    assert not (tmp_path / "out").exists()


def error_of(*arguments) -> str:
    with pytest.raises(DataError) as raised:
        capture(*arguments)
    assert "\n" not in str(raised.value)
    return str(raised.value)


def test_a_sensor_in_fog_is_refused_and_so_is_a_scene_without_sensors(tmp_path):
    fog = sensor("odd", extra='<medium type="homogeneous"/>')
    config = CaptureConfig(path="sensors")
    assert "stands in a medium" in error_of(write_scene(tmp_path, fog), tmp_path / "out", config)
    assert "has no sensor" in error_of(write_scene(tmp_path), tmp_path / "out", config)
    twice = sensor("a b"), sensor("a_b")
    assert 'two views have the name "a_b"' in error_of(write_scene(tmp_path, *twice), tmp_path / "out", config)


# --- cameras from a file ---


def cameras_file(folder: Path, *changes: dict) -> Path:
    """Cameras that look at the balls, as ``write_camera`` has them, each with changes."""
    entries = []
    for i, change in enumerate(changes):
        w2c = look_at(np.array([3.0, i - 4.0, 2.0]), np.zeros(3), "z")
        write_camera(folder / "one.json", Camera(w2c, 30 + i, 30 + i, 15.5, 13, 32, 24))
        entries.append(json.loads((folder / "one.json").read_text()) | change)
    (folder / "cameras.json").write_text(json.dumps(entries))
    return folder / "cameras.json"


def test_listed_cameras_are_captured_as_they_are_each_with_its_own_lens(tmp_path):
    file = cameras_file(tmp_path, {}, {"name": "from the side"}, {"fy": 32.01})
    config = CaptureConfig(path=str(file), spp=1, points=50, test=1)
    dataset = load_dataset(capture(write_scene(tmp_path), tmp_path / "out", config))
    assert [view.name for view in dataset.test] == ["from_the_side"]
    assert sorted(view.name for view in dataset.train) == ["000", "002"]
    for i, name in enumerate(("000", "from_the_side", "002")):
        camera = next(view.camera for view in dataset.views if view.name == name)
        w2c = look_at(np.array([3.0, i - 4.0, 2.0]), np.zeros(3), "z")
        np.testing.assert_allclose(camera.w2c, w2c, atol=1e-12)
        assert (camera.cx, camera.cy, camera.width, camera.height) == (15.5, 13, 32, 24)
        assert camera.fx == camera.fy == pytest.approx(30 + i, rel=2e-4)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"fy": 60}, "camera 1: fx=31 and fy=60 differ"),
        ({"w2c": (2 * np.eye(4)).tolist()}, "camera 1: the last row"),
        ({"width": 3.5}, "camera 1: width 3.5"),
        ({"name": "000"}, 'two views have the name "000"'),
        ({"fx": None}, "camera 1: float() argument"),
    ],
)
def test_a_listed_camera_that_cannot_be_used_is_named(tmp_path, change, problem):
    file = cameras_file(tmp_path, {}, change)
    message = error_of(write_scene(tmp_path), tmp_path / "out", CaptureConfig(path=str(file), spp=1))
    assert message.startswith(f"{file}: {problem}")


@pytest.mark.parametrize(
    ("content", "problem"), [("[]", "no list"), ("{}", "no list"), ("[1", "line 1"), (None, "cannot be read")]
)
def test_a_file_that_lists_no_cameras_is_named(tmp_path, content, problem):
    file = tmp_path / "cameras.json"
    if content is not None:
        file.write_text(content)
    message = error_of(write_scene(tmp_path), tmp_path / "out", CaptureConfig(path=str(file)))
    assert message.startswith(str(file)) and problem in message


# --- paths around a scene ---


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


# --- settings ---


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        ({"views": 0}, "--views: 0 is out of range"),
        ({"test": -1}, "--test: -1 is out of range"),
        ({"fov": 180.0}, "--fov"),
        ({"zoom": float("nan")}, "--zoom: nan"),
        ({"radius": -1.0}, "--radius"),
        ({"up": "w"}, '--up: "w" is unknown'),
        ({"depth": "png"}, '--depth: "png" is unknown; use none or exr or npy'),
        ({"path": "circle"}, '--path: "circle" is unknown; use orbit, hemisphere, sensors, or a .json'),
        ({"size": (0, 4)}, "--size: 0 x 4"),
        ({"elevations": (30.0, 20.0)}, "--elevations: 30 20"),
        ({"elevations": (0.0, 91.0)}, "--elevations"),
        ({"elevations": (90.0, 90.0)}, "--elevations: all cameras would stand at the pole"),
        ({"center": (0.0, float("inf"), 0.0)}, "--center"),
        ({"path": "sensors", "views": 9}, "--views: is not for --path sensors"),
        ({"path": "a.json", "zoom": 2.0}, "--zoom: is not for --path a.json"),
        ({"downscale": 2}, "--downscale: is not for --path hemisphere"),
    ],
)
def test_settings_that_make_no_capture_are_refused_by_the_name_of_their_flag(wrong, problem):
    with pytest.raises(DataError) as raised:
        CaptureConfig(**wrong)
    assert str(raised.value).startswith(problem) and "\n" not in str(raised.value)


def test_tests_are_spread_evenly_and_training_keeps_a_view(tmp_path):
    scene = write_scene(tmp_path, *(sensor(f"s{i:02d}") for i in range(17)))
    config = CaptureConfig(path="sensors", spp=1, points=0, downscale=10)
    names = [view.name for view in load_dataset(capture(scene, tmp_path / "a", config)).test]
    assert names == ["s00", "s08", "s16"]  # as everywhere where nothing is said
    config = CaptureConfig(path="sensors", spp=1, points=0, downscale=10, test=3)
    names = [view.name for view in load_dataset(capture(scene, tmp_path / "b", config)).test]
    assert names == ["s02", "s08", "s14"]
    config = CaptureConfig(path="sensors", test=17)
    assert "--test: 17 of 17 views leave none" in error_of(scene, tmp_path / "c", config)
