"""Data sets with other poses: everything but the poses is as before, lens and split included."""

import json
from pathlib import Path

import numpy as np
import pytest
from dataset_folders import colmap_folder
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.refined import require_photographs, write_refined
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support.errors import DataError

LENSES = {
    "PINHOLE": (20, 21, 10.5, 7.5),
    "OPENCV": (20, 21, 10.5, 7.5, 0.05, 0.01, 0.002, -0.001),
    "FULL_OPENCV": (20, 21, 10.5, 7.5, 0.05, 0.01, 0.002, -0.001, 0.003, 0.02, -0.01, 0.001),
    "OPENCV_FISHEYE": (20, 21, 10.5, 7.5, 0.02, 0.001, 0.0, 0.0),
}


def intrinsics(camera: Camera) -> tuple:
    return camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height


@pytest.mark.parametrize("lens", LENSES)
def test_a_colmap_folder_comes_back_with_its_lens_its_split_and_the_names_of_its_views(tmp_path, lens):
    colmap_folder(tmp_path / "data", camera=lens, params=LENSES[lens])
    given = load_dataset(tmp_path / "data")
    other = np.array(given.train[1].camera.w2c)
    other[0, 3] += 0.25
    folder = tmp_path / "deep" / "run" / "refined"
    write_refined(folder, given, tmp_path / "data", {given.train[1].name: other})
    refined = load_dataset(folder)
    for before, after in ((given.train, refined.train), (given.test, refined.test)):
        assert [view.name for view in after] == [view.name for view in before]
        for a, b in zip(before, after, strict=True):
            assert intrinsics(b.camera) == pytest.approx(intrinsics(a.camera), abs=1e-9)
            np.testing.assert_allclose(b.image, a.image, atol=1e-6)
            expected = other if a.name == given.train[1].name else a.camera.w2c
            np.testing.assert_allclose(b.camera.w2c, expected, atol=1e-12)
    np.testing.assert_array_equal(refined.points, given.points)


def test_a_refined_data_set_is_refined_again(data, tmp_path):
    given = load_dataset(data)
    write_refined(tmp_path / "one", given, data, {})
    once = load_dataset(tmp_path / "one")
    write_refined(tmp_path / "two", once, tmp_path / "one", {})
    one, two = (json.loads((tmp_path / name / "transforms.json").read_text()) for name in ("one", "two"))
    assert [frame["view_name"] for frame in two["frames"]] == [view.name for view in sorted(given.views, key=name_of)]
    assert [frame["file_path"] for frame in two["frames"]] == [frame["file_path"] for frame in one["frames"]]
    assert two["test_filenames"] == one["test_filenames"] and len(one["test_filenames"]) == len(given.test)


def test_photographs_on_another_drive_are_named_by_where_they_lie(data, tmp_path, monkeypatch):
    def relpath(path, start):
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr("os.path.relpath", relpath)
    given = load_dataset(data)
    write_refined(tmp_path / "refined", given, data, {})
    assert [view.name for view in load_dataset(tmp_path / "refined").train] == [view.name for view in given.train]


def test_photographs_are_found_where_the_run_or_its_data_are_behind_a_link(data, tmp_path):
    (tmp_path / "a" / "disk").mkdir(parents=True)
    (tmp_path / "runs").symlink_to(tmp_path / "a" / "disk")  # of another depth
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "photos").symlink_to(data)
    named = tmp_path / "b" / "photos"
    given = load_dataset(named)
    write_refined(tmp_path / "runs" / "one", given, named, {})
    assert [view.name for view in load_dataset(tmp_path / "runs" / "one").train] == [view.name for view in given.train]


def name_of(view) -> str:
    return view.name


def test_photographs_are_required():
    require_photographs(Path("photos"))
    with pytest.raises(DataError, match="exact; train without --refine-poses"):
        require_photographs(Path("scene.xml"))


def test_poses_of_smaller_images_alone_are_not_refined(tmp_path):
    colmap_folder(tmp_path)
    require_photographs(tmp_path)
    (tmp_path / "images").rename(tmp_path / "images_2")
    with pytest.raises(DataError, match="images: no such folder, and poses are refined by the images in it; put the"):
        require_photographs(tmp_path)
