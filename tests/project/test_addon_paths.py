"""Camera paths: the add-on refuses what the package refuses, in one line."""

import json

import numpy as np
import pytest
from mi_dogsplat.film.key_frames import key_frames_path
from mi_dogsplat.support.errors import DataError

AIMED = {"position": [0, 0, 0], "look_at": [1, 0, 0]}
GIVEN = {"w2c": np.eye(4).tolist(), "fx": 10, "width": 10, "height": 8}
UP, NAN, INFINITE = np.array([0.0, 0.0, 1.0]), float("nan"), float("inf")
REFUSED = {
    "up is a word": {"up": "y", "keys": [AIMED]},
    "up has two numbers": {"up": [0, 1], "keys": [AIMED]},
    "up is nothing": {"up": None, "keys": [AIMED]},
    "up is not finite": {"up": [NAN, 0, 1], "keys": [AIMED]},
    "up has no direction": {"up": [0, 0, 0], "keys": [AIMED]},
    "a time that is not finite": [AIMED | {"time": 0}, AIMED | {"time": NAN}],
    "a time without an end": [AIMED | {"time": 0}, AIMED | {"time": INFINITE}],
    "a time for one of two": [AIMED | {"time": 0}, AIMED],
    "times that fall": [AIMED | {"time": 1}, AIMED | {"time": 0}],
    "a focal length below 0": [GIVEN | {"fx": -10}],
    "no focal length": [GIVEN | {"fy": 0}],
    "a focal length that is not finite": [GIVEN | {"fx": NAN}],
    "a centre that is not finite": [GIVEN | {"cx": INFINITE}],
    "no pixel": [GIVEN | {"width": 0}],
    "a part of a pixel": [GIVEN | {"width": 9.5}],
    "pixels without an end": [GIVEN | {"height": INFINITE}],
    "a field of view that is not finite": [AIMED | {"fov": NAN}],
    "a place that is a word": [AIMED | {"position": "here"}],
    "a number for a key": [3],
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_path_that_the_package_refuses_is_refused(addon, tmp_path, what):
    path = tmp_path / "keys.json"
    path.write_text(json.dumps(REFUSED[what]))
    with pytest.raises(DataError):
        key_frames_path(path, UP, None)
    with pytest.raises(addon("files.errors").FileError) as caught:
        addon("cameras.path_file").read_path(path, 10, 8, UP)
    assert str(caught.value).startswith(f"{path}: ") and len(str(caught.value).splitlines()) == 1


def test_numbers_of_cameras_are_those_of_the_file(addon, tmp_path):
    """Pixels may be written with a point, and centres be left out."""
    path = tmp_path / "keys.json"
    path.write_text(json.dumps([GIVEN | {"fy": 12, "width": 10.0, "cy": 3}]))
    (key,) = addon("cameras.path_file").read_path(path, 640, 480, UP)
    camera = key.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height) == (10, 12, 5, 3, 10, 8)
    assert type(camera.width) is type(camera.height) is int and key.sized
