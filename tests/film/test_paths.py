"""Camera paths: orbits close and look at their middle, paths along cameras keep near them, key frames are met."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.film import data_path
from mi_dogsplat.film.camera_path import CameraPath, Lens, focal_of_camera, focal_of_fov
from mi_dogsplat.film.data_path import cameras_path, steps_along, steps_between_poses, walk
from mi_dogsplat.film.film_config import FilmConfig
from mi_dogsplat.film.key_frames import key_frames_path
from mi_dogsplat.film.orbit import around_cameras, around_model, orbit, stand_all_around
from mi_dogsplat.render.framing import automatic_camera, likely_up, robust_sphere
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.orientation import up_of_cameras
from mi_dogsplat.support.errors import DataError
from scipy.spatial.transform import Rotation

Z = np.array([0.0, 0.0, 1.0])


def positions(path: CameraPath, shares) -> np.ndarray:
    return np.array([path.at(share).c2w[:3, 3] for share in shares])


def row_of_cameras(n: int = 12, trembling: float = 0.0) -> list[Camera]:
    """Cameras along a line in x that look along y, each off its place at random."""
    rng = np.random.default_rng(5)
    places = np.stack([np.linspace(-2, 2, n), np.full(n, -5.0), np.zeros(n)], 1) + trembling * rng.normal(size=(n, 3))
    return [Camera(look_at(place, place + (0, 5, 0), "z"), 60, 60, 24, 18, 48, 36) for place in places]


# --- moments ---


@pytest.mark.parametrize("closed", [True, False])
def test_a_film_of_a_closed_path_leaves_out_the_end_that_is_its_beginning(closed):
    path = CameraPath(orbit(around_model(tiny_data.truth(), Z, None), FilmConfig()).at, closed, "")
    n, steps = path.frames(2.5, 2)
    moments = path.moments(n, steps)
    assert moments.shape == (5, 1)
    np.testing.assert_allclose(moments[:, 0], np.arange(5) / (5 if closed else 4))
    assert path.moments(*path.frames(0.1, 1)).tolist() == [[0.0]]
    assert path.frames(None, 3)[0] == 30


@pytest.mark.parametrize("fps, count", [(24, 25), (12, 13), (7, 8), (30, 31), (100, 101)])
def test_frames_of_keys_that_say_their_times_are_at_their_own(fps, count):
    """25 frames of another program, at 24 in a second. A way that ends between two frames has none at its end. A time
    that is asked for stretches the keys, and a loop goes on."""
    path = CameraPath(lambda share: None, False, "", 49 / 24 - 25 / 24)  # pyright: ignore[reportArgumentType]
    n, steps = path.frames(None, fps)
    assert n == count and path.seconds is not None
    np.testing.assert_allclose(path.moments(n, steps)[:, 0] * path.seconds, np.arange(n) / fps, atol=1e-6)
    longer = replace(path, seconds=1 + 0.3 / fps)
    n, steps = longer.frames(None, fps)
    assert n == count and longer.moments(n, steps).max() == pytest.approx(fps / (fps + 0.3))
    assert path.frames(2.0, fps) == (2 * fps, 2 * fps - 1)
    assert replace(path, closed=True).frames(None, fps) == (fps, fps)
    assert replace(path, seconds=1e-9).frames(None, fps)[0] == 1


def test_the_moments_of_an_exposure_spread_over_the_open_shutter():
    path = CameraPath(lambda share: None, True, "")  # pyright: ignore[reportArgumentType]
    moments = path.moments(10, 10, shutter=0.5, samples=4)
    np.testing.assert_allclose(moments[3], (3 + 0.5 * np.array([-0.375, -0.125, 0.125, 0.375])) / 10)
    assert moments.min() >= 0 and moments.max() < 1  # before the first frame is after the last one
    ends = CameraPath(path.at, False, "").moments(10, 9, shutter=0.5, samples=4)
    assert ends.min() == 0 and ends.max() == 1


def test_paths_are_told_apart_by_where_they_lead_whatever_the_last_bits():
    def path(scale: float = 1.0, turn: float = 0.0, focal: float = 1.2) -> CameraPath:
        def at(share: float) -> Lens:
            place = scale * np.array([np.cos(share), -0.0 if scale == 1 else 0.0, np.sin(share)])
            return Lens(affine(Rotation.from_euler("y", share + turn).as_matrix(), place), focal)

        return CameraPath(at, False, "an arc")

    def sha256(other: CameraPath) -> str:
        return other.sha256(other.moments(5, 4, 0.5, 2))

    same = sha256(path())
    assert sha256(path(1 + 1e-15, 1e-15, 1.2 + 1e-15)) == same
    others = [sha256(path(2.0)), sha256(path(turn=1e-6)), sha256(path(focal=1.2001)), sha256(path(1 + 1e-6))]
    assert len({same, *others, path().sha256(np.zeros(1))}) == 6


# --- orbits ---


def test_an_orbit_around_a_point_far_from_the_origin_has_cameras():
    """Whose extent is less than any number tells apart there."""
    model = tiny_data.truth()
    model.means[:], model.log_scales[:] = (1000, 5, 3), -40
    path = orbit(around_model(model, Z, None), FilmConfig())
    for share in (0.0, 0.3):
        assert path.at(share).camera(64, 48).project(model.means[:1])[0][0] == pytest.approx([32, 24], abs=0.01)


@pytest.mark.parametrize(("elevation", "said"), [(-30.0, "-30"), (0.0, "0"), (-1e-14, "0"), (70.0, "70")])
def test_an_orbit_is_a_level_circle_that_looks_at_the_model(elevation, said):
    model = tiny_data.truth()
    centre, radius = robust_sphere(model)
    path = orbit(around_model(model, Z, 50), FilmConfig(elevation=elevation))
    assert path.what == f"an orbit, {said} degrees above the horizon"
    around = around_model(model, Z, 50)
    shares = np.linspace(0, 1, 37)
    offsets = positions(path, shares) - centre
    np.testing.assert_allclose(offsets[0], offsets[-1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), radius / np.sin(np.radians(25)), rtol=1e-12)
    np.testing.assert_allclose(offsets @ around.up, around.distance * np.sin(np.radians(elevation)), atol=1e-12)
    steps = np.linalg.norm(np.diff(offsets, axis=0), axis=1)
    np.testing.assert_allclose(steps, steps[0])
    for share in shares:
        camera = path.at(share).camera(320, 200)
        pixel, depth = camera.project(centre)
        np.testing.assert_allclose(pixel, [[160, 100]], atol=1e-9)
        assert depth > 0 and -camera.w2c[1, :3] @ around.up > 0 and abs(camera.w2c[0, :3] @ around.up) < 1e-12
        down, forward = camera.w2c[1, :3], camera.w2c[2, :3]
        rim = centre + radius * (down * np.cos(np.radians(25)) - forward * np.sin(np.radians(25)))
        assert camera.project(rim)[0][0, 1] == pytest.approx(200)  # the sphere just fits the shorter side


def test_an_orbit_begins_where_the_model_is_framed_from():
    model = tiny_data.truth()
    first = orbit(around_model(model, likely_up(model), None), FilmConfig()).at(0).c2w
    np.testing.assert_allclose(first, automatic_camera(model).c2w, atol=1e-9)


def test_an_orbit_of_a_data_set_stands_on_the_ring_of_its_cameras():
    offset = np.array([40.0, -7.0, 3.0])
    shift = affine(np.eye(3), -offset)  # away from the origin
    cameras = [replace(c, w2c=c.w2c @ shift) for i, c in enumerate(tiny_data.cameras(16)) if i % 2]  # one height
    around = around_cameras(cameras, up_of_cameras(np.stack([camera.c2w for camera in cameras])), None)
    np.testing.assert_allclose(around.centre, offset, atol=1e-9)
    np.testing.assert_allclose(around.up, Z, atol=1e-9)
    path = orbit(around, FilmConfig())
    np.testing.assert_allclose(positions(path, np.arange(8) / 8), [c.position for c in cameras], atol=1e-9)
    assert path.at(0.3).focal == pytest.approx(focal_of_camera(cameras[0]))
    nearer = positions(orbit(around, FilmConfig(zoom=2)), [0.0])
    np.testing.assert_allclose((nearer - offset) * 2, positions(path, [0.0]) - offset)


@pytest.mark.parametrize("trembling", [0, 1e-9, 1e-3])
def test_an_orbit_of_cameras_that_look_around_is_a_turn_on_the_spot(trembling):
    """As level as they look, first to where the first looks: rounding, or a hand, decides neither."""
    rng = np.random.default_rng(0)
    azimuths = 0.4 + np.arange(24) * np.pi / 12
    directions = np.stack([np.cos(azimuths), np.sin(azimuths), np.full(24, 0.3)], axis=1)  # [24, 3]
    places = np.array([1.0, 2, 3]) + trembling * rng.normal(size=(24, 3))
    around = [Camera(look_at(p, p + d, "z"), 60, 60, 24, 18, 48, 36) for p, d in zip(places, directions, strict=True)]
    path = orbit(around_cameras(around, Z, None), FilmConfig())
    for k in range(0, 24, 5):
        np.testing.assert_allclose(path.at(k / 24).c2w[:3, 2], around[k].w2c[2, :3], atol=1e-6)
    np.testing.assert_allclose(positions(path, [0, 0.5]), places[:2], atol=max(1e-5, 5 * trembling))
    assert not stand_all_around(around, Z)


def test_cameras_on_one_side_are_no_ring():
    ring = tiny_data.cameras(12)
    assert stand_all_around(ring, Z) and not stand_all_around(ring[:7], Z)
    assert not stand_all_around(row_of_cameras(), Z)
    np.testing.assert_allclose(up_of_cameras(np.stack([camera.c2w for camera in ring])), Z, atol=1e-9)


# --- along cameras ---


def test_without_smoothing_the_path_leads_through_every_camera():
    cameras = tiny_data.cameras(9)
    path = cameras_path(cameras, FilmConfig(path="cameras", smoothing=0))
    fine = [path.at(share).c2w for share in np.linspace(0, 1, 4001)]
    for camera in cameras:
        away = min(abs(c2w - camera.c2w).max() for c2w in fine)
        assert away < 5e-3
    np.testing.assert_allclose(path.at(0).c2w, cameras[0].c2w, atol=1e-9)
    np.testing.assert_allclose(path.at(1).c2w, cameras[-1].c2w, atol=1e-9)
    assert path.size == (48, 36)


def test_smoothing_takes_the_trembling_out():
    shares = np.linspace(0.1, 0.9, 200)
    steady, trembling = row_of_cameras(40), row_of_cameras(40, 0.1)
    rough = positions(cameras_path(trembling, FilmConfig(smoothing=0)), shares)
    smooth = positions(cameras_path(trembling, FilmConfig(smoothing=3)), shares)
    line = np.linspace(-2, 2, 40)
    assert abs(smooth[:, 1:] - (-5, 0)).max() < 0.5 * abs(rough[:, 1:] - (-5, 0)).max()
    assert line[0] < smooth[0, 0] < smooth[-1, 0] < line[-1] and (np.diff(smooth[:, 0]) > 0).all()
    exact = cameras_path(steady, FilmConfig(smoothing=3))
    np.testing.assert_allclose(positions(exact, shares)[:, 1:], np.tile([-5, 0], (200, 1)), atol=1e-9)


def test_the_path_is_taken_at_an_even_pace():
    path = cameras_path(tiny_data.cameras(24)[::2], FilmConfig(smoothing=0))
    steps = np.linalg.norm(np.diff(positions(path, np.linspace(0, 1, 200)), axis=0), axis=1)
    assert steps.max() < 1.1 * steps.min()


def test_a_change_of_the_lens_at_one_place_takes_time_and_does_not_swing_beyond():
    def camera(x: float, focal: float) -> Camera:
        return Camera(affine(np.eye(3), (-x, 0, 5)), focal, focal, 8, 6, 16, 12)

    for near in (1e-4, 0.0):  # from a tripod
        cameras = [*(camera(x, 20) for x in range(5)), *(camera(x + near, 60) for x in range(4, 9))]
        path = cameras_path(cameras, FilmConfig(smoothing=0))
        focals = np.array([path.at(share).focal for share in np.linspace(0, 1, 101)]) * 12
        assert focals.min() > 17 and focals.max() < 70
        steps = np.abs(np.diff(np.log(focals)))
        assert steps.max() < 0.1  # no leap


def test_scattered_cameras_are_visited_along_a_short_tour(monkeypatch):
    rng = np.random.default_rng(0)
    line = np.arange(30.0)
    apart = abs(line[:, None] - line)
    with monkeypatch.context() as context:  # in order already: of thousands of cameras a tour takes long to find
        context.setattr(data_path, "_from_neighbour_to_neighbour", lambda steps: pytest.fail("looks for a tour"))
        assert walk(apart).tolist() == list(range(30))
    mixed = np.concatenate([[0], 1 + rng.permutation(29)])
    order = walk(apart[np.ix_(mixed, mixed)])
    assert sorted(order) == list(range(30)) and mixed[order].tolist() == list(range(30))


def test_steps_between_poses_are_shares_of_the_largest_distance_and_angles():
    rng = np.random.default_rng(1)
    positions, turns = rng.normal(size=(7, 3)), Rotation.from_quat(rng.normal(size=(7, 4)))
    distances = np.linalg.norm(positions[:, None] - positions, axis=2)
    angles = np.array([[(a.inv() * b).magnitude() for b in turns] for a in turns])
    steps = steps_between_poses(positions, turns.as_matrix())
    np.testing.assert_allclose(steps, distances / distances.max() + angles, atol=1e-6)
    np.testing.assert_allclose(steps_along(positions, turns.as_matrix()), np.diag(steps, 1), atol=1e-6)


def test_cameras_at_one_place_make_a_film_that_stands_still():
    camera = tiny_data.cameras()[0]
    for cameras in ([camera], [camera] * 3):
        path = cameras_path(cameras, FilmConfig())
        np.testing.assert_allclose(path.at(0.5).c2w, camera.c2w, atol=1e-7)  # a mean of quaternions is that exact


# --- key frames ---


def keys_file(tmp_path: Path, content) -> Path:
    path = tmp_path / "keys.json"
    path.write_text(json.dumps(content))
    return path


def test_every_kind_of_key_is_met_at_its_time(tmp_path):
    camera = tiny_data.cameras()[3]
    write_camera(tmp_path / "camera.json", camera)
    turn = Rotation.from_euler("xyz", [0.3, -0.2, 2.0])
    keys = [
        {"time": 1, "position": [3, 0, 1], "look_at": [0, 0, 0], "fov": 50},
        {"time": 2.5, "position": [2, 2, 2], "rotation": turn.as_quat().tolist()},
        {"time": 4, **json.loads((tmp_path / "camera.json").read_text())},
    ]
    path = key_frames_path(keys_file(tmp_path, {"keys": keys}), Z, None)
    assert not path.closed and path.seconds == 3
    first, second, third = (path.at(share) for share in (0, 0.5, 1))
    assert first.camera(64, 48).project([0, 0, 0])[0][0] == pytest.approx([32, 24])
    np.testing.assert_allclose(second.c2w[:3, :3], turn.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(second.c2w[:3, 3], [2, 2, 2], atol=1e-9)
    assert first.focal == pytest.approx(second.focal) == focal_of_fov(50)  # kept where a key says none
    np.testing.assert_allclose(third.c2w, camera.c2w, atol=1e-9)
    np.testing.assert_allclose(third.camera(48, 36).K, camera.K)


def test_a_key_that_is_a_camera_keeps_its_principal_point_at_any_size(tmp_path):
    """That of Blender's shifted lenses; between keys it moves evenly."""
    pose = tiny_data.cameras()[3].w2c
    listed = [Camera(pose, 60, 60, cx, cy, 64, 48) for cx, cy in ((44, 12), (32, 24))]
    entries = []
    for camera in listed:
        write_camera(tmp_path / "camera.json", camera)
        entries.append(json.loads((tmp_path / "camera.json").read_text()))
    path = key_frames_path(keys_file(tmp_path, entries), Z, None)
    np.testing.assert_allclose(path.at(0).camera(64, 48).K, listed[0].K)
    np.testing.assert_allclose(path.at(1).camera(64, 48).K, listed[1].K)
    np.testing.assert_allclose(path.at(0.5).camera(128, 96).K[:2, 2], [76, 36])
    middle = key_frames_path(keys_file(tmp_path, [entries[1]] * 2), Z, None)
    assert path.sha256(np.zeros(1)) != middle.sha256(np.zeros(1))


def test_between_keys_that_look_at_points_the_camera_looks_at_points_between(tmp_path):
    keys = [{"position": [3, 0, 1], "look_at": [0, 0, 0]}, {"position": [0, 3, 1], "look_at": [0, 0, 0]},
            {"position": [-3, 0, 2], "look_at": [0, 0, 0]}]  # fmt: skip
    path = key_frames_path(keys_file(tmp_path, keys), Z, 35)
    assert path.seconds is None
    for share in np.linspace(0, 1, 23):
        camera = path.at(share).camera(100, 60)
        assert camera.project([0, 0, 0])[0][0] == pytest.approx([50, 30], abs=1e-9)
        assert path.at(share).focal == pytest.approx(focal_of_fov(35))


def test_a_loop_returns_within_the_mean_time_between_keys(tmp_path):
    keys = [{"time": t, "position": [np.cos(t), np.sin(t), 1], "look_at": [0, 0, 0]} for t in (0, 2, 4)]
    path = key_frames_path(keys_file(tmp_path, {"keys": keys, "loop": True}), Z, None)
    assert path.closed and path.seconds == 6
    np.testing.assert_allclose(path.at(0).c2w, path.at(1).c2w, atol=1e-9)
    np.testing.assert_allclose(path.at(1 / 3).c2w[:3, 3], [np.cos(2), np.sin(2), 1], atol=1e-9)


def test_the_upright_direction_of_the_file_wins(tmp_path):
    key = {"position": [3, 0, 0], "look_at": [0, 0, 0]}
    for up in ([0, 2, 0], [0, 0, -1]):
        lens = key_frames_path(keys_file(tmp_path, {"keys": [key], "up": up}), Z, None).at(0.7)
        np.testing.assert_allclose(-lens.c2w[:3, 1], np.array(up) / np.linalg.norm(up), atol=1e-12)


GOOD = {"position": [3, 0, 0], "look_at": [0, 0, 0]}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ([], "has no list of keys"),
        ({"keys": 3}, "has no list of keys"),
        ([7], "key 0: is not a JSON object"),
        ([{**GOOD, "position": [1, 2]}], 'key 0: "position" is not 3 numbers'),
        ([{"look_at": [0, 0, 0]}], 'key 0: lacks "position"'),
        ([GOOD, {"position": [0, 0, 1]}], 'key 1: needs "look_at" or "rotation"'),
        ([{**GOOD, "rotation": [0, 0, 0, 1]}], "one of them"),
        ([{**GOOD, "look_at": [3, 0, 0]}], "at the position itself"),
        ([{**GOOD, "look_at": [3, 0, 9]}], "straight above"),
        ([{"position": [0, 0, 0], "rotation": [0, 0, 0, 0]}], "not a unit quaternion"),
        ([{**GOOD, "fov": 180}], '"fov" is 180'),
        ([{**GOOD, "time": "soon"}], 'key 0: "time" is "soon", no number'),
        ([{**GOOD, "fov": None}], 'key 0: "fov" is null, no number'),
        ([{**GOOD, "time": float("nan")}], '"time" is not finite'),
        ([{**GOOD, "time": 1}, GOOD], 'key 1 lacks "time"'),
        ([{**GOOD, "time": 1}, {**GOOD, "time": 1}], "key 1 is not later"),
        ({"keys": [GOOD], "up": [0, 0, 0]}, '"up" has no direction'),
        ({"keys": [GOOD], "up": "z"}, '"up" is not 3 numbers'),
        ({"keys": [GOOD], "loop": "yes"}, '"loop" is'),
        ([{"w2c": np.eye(4).tolist()}], 'key 0: lacks "fx"'),
        ([{**GOOD, "position": [1e200, 0, 0]}, GOOD], 'key 0: "position" is beyond 1e+15'),
        ([GOOD, {**GOOD, "look_at": [0, -1e200, 0]}], 'key 1: "look_at" is beyond 1e+15'),
        ([{**GOOD, "fov": 1e-320}, GOOD], '"fov" is 9.99989e-321, not within 1e-06 to 180 degrees'),
        ([{**GOOD, "time": -1e308}, {**GOOD, "time": 1e308}], 'key 0: "time" is beyond 1e+15'),
        ([{**GOOD, "time": 0}, {**GOOD, "time": 1e-320}], "key 1 is not later"),
        ({"keys": [GOOD], "up": [1e200, 0, 1e200]}, '"up" is beyond 1e+15'),
        ({"keys": [GOOD], "up": [10**400, 0, 1]}, '"up" is not 3 numbers'),
        ([{**GOOD, "time": time, "fov": 40 if time < 5 else 25} for time in (0, 4.999, 5, 60)], '"fov" changes too'),
        ([{"w2c": np.eye(4).tolist(), "fx": 1e-300, "width": 9, "height": 9}, GOOD], "key 0: its position is beyond"),
        ([{"w2c": affine(np.eye(3), [0, 1e16, 0]).tolist(), "fx": 9, "width": 9, "height": 9}], "its position is"),
        ([{"w2c": np.eye(4).tolist(), "fx": 9, "cx": 1e20, "width": 9, "height": 9}, GOOD], "its principal point is"),
    ],
)
def test_what_is_no_key_is_named(tmp_path, content, words):
    path = keys_file(tmp_path, content)
    with pytest.raises(DataError) as error:
        key_frames_path(path, Z, None)
    assert words in str(error.value) and str(error.value).startswith(str(path)) and "\n" not in str(error.value)
