"""Where the cameras of a capture stand: exactly where Mitsuba's sensors do, or around what there is to look at."""

import json
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from captured_scenes import error_of, sensor, write_scene
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.datasets.given_cameras import listed_shots
from mi_dogsplat.datasets.scene_file import load_scene
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.scene.cameras import Camera

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
    assert 'sensor "odd"' in message and "only perspective sensors" in message and message.count("; ") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("listed", "which"), [(False, 'sensor "eye"'), (True, "camera 0")])
def test_cameras_with_too_few_pixels_to_shrink_are_told_so(tmp_path, listed, which):
    scene = write_scene(tmp_path, sensor("eye"))
    file = cameras_file(tmp_path, {}) if listed else scene
    message = error_of(scene, tmp_path / "out", CaptureConfig(path=str(file) if listed else "sensors", downscale=50))
    assert message.startswith(f"{file}: {which}: Camera: a ") and "; choose a smaller downscale factor" in message


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


@pytest.mark.parametrize("name", ["", None])
def test_a_listed_camera_without_a_name_is_called_by_its_number(tmp_path, name):
    (shot,) = listed_shots(cameras_file(tmp_path, {"name": name}), 1.0, 1)
    assert shot.name == "000"


@pytest.mark.parametrize("listed", [False, True])
def test_a_sky_is_seen_however_far_it_is_and_so_is_what_stands_near_before_it(tmp_path, listed):
    dome = """<shape type="sphere"><float name="radius" value="20000"/><boolean name="flip_normals" value="true"/>
        <emitter type="area"><rgb name="radiance" value="0, 1, 0"/></emitter></shape>"""
    settings: dict = {"path": str(cameras_file(tmp_path, {}))} if listed else {"views": 1}
    config = CaptureConfig(spp=4, points=0, test=0, alpha=False, **settings)
    view = load_dataset(capture(write_scene(tmp_path, dome, light=""), tmp_path / "out", config)).views[0]
    np.testing.assert_allclose(view.image[0, 0], (0, 1, 0), atol=0.01)
    assert (view.image[..., 1] < 0.95).mean() > 0.1  # the balls


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"fy": 60}, "camera 1: fx=31 and fy=60 differ"),
        ({"w2c": (2 * np.eye(4)).tolist()}, "camera 1: the last row"),
        ({"width": 3.5}, "camera 1: width 3.5"),
        ({"name": "000"}, 'two views have the name "000"'),
        ({"fx": None}, 'camera 1: "fx" is null, no number'),
    ],
)
def test_a_listed_camera_that_cannot_be_used_is_named(tmp_path, change, problem):
    file = cameras_file(tmp_path, {}, change)
    message = error_of(write_scene(tmp_path), tmp_path / "out", CaptureConfig(path=str(file), spp=1))
    assert message.startswith(f"{file}: {problem}")


@pytest.mark.parametrize(
    ("content", "problem"), [("[]", "not a list"), ("{}", "not a list"), ("[1", "line 1"), (None, "cannot be read")]
)
def test_a_file_that_lists_no_cameras_is_named(tmp_path, content, problem):
    file = tmp_path / "cameras.json"
    if content is not None:
        file.write_text(content)
    message = error_of(write_scene(tmp_path), tmp_path / "out", CaptureConfig(path=str(file)))
    assert message.startswith(str(file)) and problem in message
