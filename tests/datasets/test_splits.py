"""Validation views in place of the test views, which stay unread."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dataset_folders import HEIGHT, WIDTH, colmap_folder, error_of, transforms_folder
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.dataset import View, held_out, views_named
from mi_dogsplat.scene.cameras import Camera
from scene_files import scene_file


def names_of(path: Path, **options) -> tuple[list[str], list[str]]:
    dataset = load_dataset(path, split="validation", **options)
    return [view.name for view in dataset.train], [view.name for view in dataset.test]


def test_every_eighth_training_view_is_measured_and_no_test_view():
    train, test = list(range(1, 21)), [0, 99]
    assert held_out(train, test, "test") == (train, test)
    rest, measured = held_out(train, test, "validation")
    assert measured == [1, 9, 17] and rest == [view for view in train if view not in measured]


def test_a_single_training_view_is_kept_for_training():
    assert held_out([3], [0], "validation") == ([3], [])


@pytest.mark.parametrize("on_disk", [False, True])
def test_a_colmap_folder_is_read_without_its_test_views(tmp_path, on_disk):
    colmap_folder(tmp_path)
    (tmp_path / "images" / "img_08.png").write_bytes(b"no picture")
    assert "img_08.png" in error_of(tmp_path, on_disk=on_disk)
    train, measured = names_of(tmp_path, on_disk=on_disk)
    assert measured == ["img_01"] and train == [f"img_{i:02d}" for i in (2, 3, 4, 5, 6, 7, 9)]


def test_observations_stay_with_the_views_that_are_read(tmp_path):
    colmap_folder(tmp_path)
    assert list(load_dataset(tmp_path).observations) == ["img_00"]  # the only view with any, a test view
    assert load_dataset(tmp_path, split="validation").observations == {}


@pytest.mark.parametrize("files", ["one file", "named test views", "two files"])
def test_a_transforms_folder_is_read_without_its_test_views(tmp_path, files):
    size: dict[str, Any] = {"w": WIDTH, "h": HEIGHT}
    if files == "two files":
        transforms_folder(tmp_path, "transforms_train.json", 10, "train", **size)
        transforms_folder(tmp_path, "transforms_test.json", 2, "test", **size)
        broken, kept = "test/r_1.png", [f"train_r_{i}" for i in range(10)]
    else:
        transforms_folder(tmp_path, n=10, **size)
        tests = [0, 8]
        if files == "named test views":
            tests, file = [5], tmp_path / "transforms.json"
            file.write_text(json.dumps({**json.loads(file.read_text()), "test_filenames": ["images/r_5.png"]}))
        broken, kept = f"images/r_{tests[-1]}.png", [f"r_{i}" for i in range(10) if i not in tests]
    (tmp_path / broken).write_bytes(b"no picture")
    assert broken.split("/")[1] in error_of(tmp_path)
    train, measured = names_of(tmp_path)
    assert measured == kept[::8] and train == [name for name in kept if name not in measured]


def test_views_that_the_data_have_for_validation_are_measured_and_never_trained_on(tmp_path):
    size: dict[str, Any] = {"w": WIDTH, "h": HEIGHT}
    for part, n in (("train", 9), ("val", 2), ("test", 2)):
        transforms_folder(tmp_path, f"transforms_{part}.json", n, part, **size)
    trained, validation = [f"train_r_{i}" for i in range(9)], ["val_r_0", "val_r_1"]
    (tmp_path / "test" / "r_1.png").write_bytes(b"no picture")
    assert names_of(tmp_path) == (trained, validation)
    (tmp_path / "transforms_test.json").unlink()
    dataset = load_dataset(tmp_path)  # nothing else is for testing
    assert ([view.name for view in dataset.train], [view.name for view in dataset.test]) == (trained, validation)
    assert names_of(tmp_path) == (trained[1:8], [trained[0], trained[8]])


@pytest.mark.parametrize("copied", ["train", "test"])
def test_a_copy_of_another_file_holds_no_views_for_validation(tmp_path, copied):
    for part, n in (("train", 9), ("test", 2)):
        transforms_folder(tmp_path, f"transforms_{part}.json", n, part)
    (tmp_path / "transforms_val.json").write_text((tmp_path / f"transforms_{copied}.json").read_text())
    assert names_of(tmp_path) == ([f"train_r_{i}" for i in range(1, 8)], ["train_r_0", "train_r_8"])


def test_views_for_validation_need_not_be_there_where_others_are_measured(tmp_path):
    for part, n in (("train", 9), ("val", 2), ("test", 2)):
        transforms_folder(tmp_path, f"transforms_{part}.json", n, part)
    (tmp_path / "val" / "r_1.png").unlink()
    assert len(load_dataset(tmp_path).views) == 11
    assert "val/r_1" in error_of(tmp_path, split="validation")


@pytest.mark.parametrize("train", [True, False])
def test_val_filenames_are_measured_where_they_are_no_test_views(tmp_path, train):
    def named(*numbers: int) -> list[str]:
        return [f"images/r_{i}.png" for i in numbers]

    lists: dict[str, Any] = {"val_filenames": named(3), "test_filenames": named(4)}
    lists |= {"train_filenames": named(0, 1, 2)} if train else {}
    transforms_folder(tmp_path, n=6, **lists)
    rest = ["r_0", "r_1", "r_2"] if train else ["r_0", "r_1", "r_2", "r_5"]
    assert names_of(tmp_path) == (rest, ["r_3"])
    assert {view.name for view in load_dataset(tmp_path).train} == {*rest, *(() if train else ("r_3",))}
    transforms_folder(tmp_path, n=9, val_filenames=named(4), test_filenames=named(4))  # as dogsplat capture has it
    assert names_of(tmp_path)[1] == ["r_0"]


def test_a_mitsuba_scene_renders_the_same_pictures_of_the_views_that_are_left(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    file = scene_file(tmp_path, n=4)
    pictures = {view.name: view.image for view in load_dataset(file, spp=4).views}
    dataset = load_dataset(file, spp=4, split="validation")
    assert [view.name for view in dataset.test] == ["cam1"]
    assert [view.name for view in dataset.train] == ["cam2", "cam3"]
    assert all((view.image == pictures[view.name]).all() for view in dataset.views)


def test_views_of_large_captures_are_chosen_in_one_pass():
    """A set of all names for each of them would take a minute for 20,000."""

    class Names(list):
        passes = 0

        def __iter__(self):
            self.passes += 1
            return super().__iter__()

    views = [View(str(i), Camera(np.eye(4), 1, 1, 0.5, 0.5, 1, 1), np.zeros((1, 1, 3), np.float32)) for i in range(9)]
    names = Names(["8", "2", "none"])
    assert [view.name for view in views_named(views, names)] == ["2", "8"] and names.passes == 1


def test_an_image_that_is_to_be_trained_on_and_to_be_measured_is_told(tmp_path):
    transforms_folder(tmp_path, "transforms_train.json")
    content = json.loads((tmp_path / "transforms_train.json").read_text())
    (tmp_path / "transforms_test.json").write_text(json.dumps(content | {"frames": content["frames"][1:2]}))
    said = 'transforms_test.json: "r_1" is in transforms_train.json too; remove it from one of the two'
    assert error_of(tmp_path).endswith(said)
