"""Captures in coordinates of the earth are told of, before they are trained on in single precision."""

import json

import pytest
import tiny_data
from command_line import run
from dataset_folders import colmap_folder
from mi_dogsplat.datasets.far_origin import far_from_origin


def moved(folder, offset):
    file = tiny_data.write_tiny_data(folder) / "transforms.json"
    content = json.loads(file.read_text())
    for frame in content["frames"]:
        for axis, by in enumerate(offset):
            frame["transform_matrix"][axis][3] += by
    file.write_text(json.dumps(content))
    return file


@pytest.mark.parametrize(("offset", "far"), [((0, 0, 0), False), ((1000, 0, 0), False), ((4e5, 5.6e6, 100), True)])
def test_cameras_that_single_precision_cannot_place_are_told(tmp_path, offset, far):
    file = moved(tmp_path, offset)
    lines = far_from_origin(tmp_path)
    assert lines == far_from_origin(file) and len(lines) == far
    if far:
        said = "5.6e+06 units from the origin, where a model cannot tell places apart that are nearer than 0.5"
        assert said in lines[0]


def test_those_of_colmap_are_told_too(tmp_path):
    colmap_folder(tmp_path)
    assert far_from_origin(tmp_path) == []
    path = tmp_path / "sparse" / "0" / "images.txt"
    path.write_text(path.read_text().replace(" 0.0 0.0 7 img", " 3000000.0 0.0 7 img"))
    assert "3e+06 units from the origin" in far_from_origin(tmp_path)[0]


def test_frames_without_poses_are_left_to_the_reader(tmp_path):
    (tmp_path / "transforms.json").write_text('{"frames": [{}, {"transform_matrix": "none"}, 3]}')
    assert far_from_origin(tmp_path) == [] == far_from_origin(tmp_path / "none")


def test_info_and_train_say_so(tmp_path, capsys):
    file = moved(tmp_path / "data", (0, 2e6, 0))
    content = json.loads(file.read_text())
    file.write_text(json.dumps({name: value for name, value in content.items() if name != "ply_file_path"}))
    said = "subtract their mean position from poses and points first"
    assert said in run(capsys, "info", tmp_path / "data")[1]
    small = ["--preset", "3dgs", "--steps", "2", "--sh-degree", "0", "--initial-primitives", "50"]
    status, printed, _ = run(capsys, "train", tmp_path / "data", "-o", tmp_path / "run", *small)
    assert status == 0 and printed.count(said) == 1
