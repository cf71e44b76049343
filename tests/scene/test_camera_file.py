"""Cameras as JSON files: they come back, may leave out what follows, and wrong ones are told in one line."""

import json

import numpy as np
import pytest
import tiny_data
from mi_dogsplat.scene.camera_file import read_camera, write_camera
from mi_dogsplat.support.errors import DataError


def test_a_camera_comes_back_from_its_file(tmp_path):
    for camera in tiny_data.cameras(3):
        write_camera(tmp_path / "c.json", camera)
        back = read_camera(tmp_path / "c.json")
        np.testing.assert_allclose(back.w2c, camera.w2c, atol=1e-15)
        assert (back.fx, back.fy, back.cx, back.cy) == (camera.fx, camera.fy, camera.cx, camera.cy)
        assert (back.width, back.height) == (camera.width, camera.height)


def test_a_camera_file_may_leave_out_what_follows_from_the_rest(tmp_path):
    content = {"w2c": np.eye(4).tolist(), "fx": 50, "width": 40, "height": 30}
    (tmp_path / "c.json").write_text(json.dumps(content))
    camera = read_camera(tmp_path / "c.json")
    assert (camera.fy, camera.cx, camera.cy) == (50, 20, 15)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"w2c": None}, "pose"),
        ({"w2c": [[1, 0], [0, 1]]}, "shape"),
        ({"w2c": (2 * np.eye(4)).tolist()}, "last row|not a rotation"),
        ({"w2c": np.diag([1.0, 1, -1, 1]).tolist()}, "reflection"),
        ({"fx": -1}, "focal"),
        ({"fx": "wide"}, "wide"),
        ({"width": 10.5}, "whole numbers"),
        ({"width": 1e999}, "whole numbers"),
        ({"height": 200_000}, "too large: at most 16384"),
        ({"height": 0}, "must have a pixel"),
        ({"cx": float("nan")}, "not finite"),
        ({"cx": 0.5, "cy": 0.48}, "cx 0.5 and cy 0.48 of an image of 40x30 are shares of its sides, not pixels"),
        ({"w2c": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -1e300]]}, r"has 1e\+300: at most 1e\+30"),
        ({"fx": 1e300}, r"has 1e\+300: at most 1e\+30"),
        ({"fx": None}, '"fx" is null, no number'),
        ({"cy": None}, '"cy" is null, no number'),
        ({"width": [40]}, r'"width" is \[40\], no number'),
    ],
)
def test_a_wrong_camera_file_is_told_in_one_line_with_the_format(tmp_path, changes, message):
    content = {"w2c": np.eye(4).tolist(), "fx": 50, "width": 40, "height": 30} | changes
    (tmp_path / "c.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match=message) as caught:
        read_camera(tmp_path / "c.json")
    assert "4x4 world to camera" in str(caught.value)


def test_a_principal_point_may_be_in_a_corner_of_an_image(tmp_path):
    """As in quarters of a picture, or where the image has few pixels."""
    for changes in ({"cx": 0.0, "cy": 0.0}, {"cx": 0.5, "cy": 29.5}, {"cx": 0.5, "cy": 0.5, "width": 1, "height": 1}):
        content = {"w2c": np.eye(4).tolist(), "fx": 50, "width": 40, "height": 30} | changes
        (tmp_path / "c.json").write_text(json.dumps(content))
        assert read_camera(tmp_path / "c.json").cx == changes["cx"]


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"{", "line 1"), (b"[1]", "not a JSON object"), (b"{}", 'lacks "w2c"'), (b"\xff\xfe\x00", "not a text")],
)
def test_what_is_no_camera_file_at_all_is_told_too(tmp_path, content, message):
    (tmp_path / "c.json").write_bytes(content)
    with pytest.raises(DataError, match=message):
        read_camera(tmp_path / "c.json")
    with pytest.raises(DataError, match="cannot be read"):
        read_camera(tmp_path / "missing.json")
