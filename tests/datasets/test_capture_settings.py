"""Settings of a capture: which are refused, and which views are for tests."""

import pytest
from captured_scenes import error_of, sensor, write_scene
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.capture import capture
from mi_dogsplat.datasets.capture_config import CaptureConfig
from mi_dogsplat.support.errors import DataError


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


def test_a_centre_from_where_no_camera_can_be_told_apart_is_one_line(tmp_path):
    config = CaptureConfig(views=2, size=(8, 6), spp=1, center=(1e30, 0.0, 0.0), radius=1.0)
    assert "the centre 1e+30 0 0 is too far from the origin" in error_of(write_scene(tmp_path), tmp_path / "a", config)


def test_tests_are_spread_evenly_and_training_keeps_a_view(tmp_path):
    scene = write_scene(tmp_path, *(sensor(f"s{i:02d}") for i in range(17)))
    config = CaptureConfig(path="sensors", spp=1, points=0, downscale=10)
    names = [view.name for view in load_dataset(capture(scene, tmp_path / "a", config)).test]
    assert names == ["s00", "s08", "s16"]  # as everywhere where nothing is said
    config = CaptureConfig(path="sensors", spp=1, points=0, downscale=10, test=3)
    names = [view.name for view in load_dataset(capture(scene, tmp_path / "b", config)).test]
    assert names == ["s02", "s08", "s14"]
    config = CaptureConfig(path="sensors", test=17)
    assert "--test: no training view is left of 17 views" in error_of(scene, tmp_path / "c", config)
