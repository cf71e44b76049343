"""What a comparison is called with: refusals before anything is trained, relative paths, masks."""

import argparse
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.cli.commands import ablate as ablate_command
from mi_dogsplat.cli.commands import compare as compare_command
from mi_dogsplat.compare.compare import compare
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import TrainConfig
from PIL import Image
from small_comparison import SETTINGS
from tiny_data import HEIGHT, WIDTH


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"data": []}, "DATA: is empty; give at least one"),
        ({"seeds": []}, "--seeds: is empty; give at least one"),
        ({"methods": []}, "--only: is empty; give at least one"),
        ({"data": "nowhere"}, 'DATA: is "nowhere"; give a list, even of only one'),
        ({"methods": "ours"}, '--only: is "ours"; give a list'),
        ({"seeds": [0.5]}, "--seeds: 0.5 is not a whole number; use 0, 1, 2 and so on"),
        ({"seeds": ["a"]}, "--seeds: 'a' is not a whole number; use 0, 1, 2 and so on"),
        ({"methods": ["magic"]}, '--only: "magic" is unknown; use 3dgs, '),
        ({"seeds": [0, -1]}, "--seeds: -1 is out of range"),
        ({"workers": -1}, "--workers: -1 is out of range"),
        ({"workers": 2, "cluster": "nowhere"}, "--workers: is for runs on this machine"),
        ({"config": TrainConfig("", target="2MB")}, "--target: 2MB is the size of a file"),
        ({"config": TrainConfig("", **SETTINGS, growth=0.3)}, "--growth: changes schedules .*; leave it out"),
        ({"config": TrainConfig("", "ours", steps=60, model="a.ply")}, "--model: would give runs another start"),
        ({"targets": ["x"]}, "--more-targets: x is not a target; use a ratio"),
        ({"targets": [-1]}, "--more-targets: -1 is not a target"),
        ({"config": TrainConfig("", **SETTINGS, masks="nowhere")}, "nowhere: no such folder"),
        ({"config": TrainConfig("", **SETTINGS, masks=str(Path(__file__).parent))}, "has no mask for any"),
        ({"config": TrainConfig("", **SETTINGS, depths=str(Path(__file__).parent))}, "has no depth map for any"),
    ],
)
def test_bad_arguments_are_one_line_and_make_no_folder(data, tmp_path, arguments, message):
    given = {"config": TrainConfig("", **SETTINGS), "data": [str(data)], "out": tmp_path / "out"} | arguments
    with pytest.raises(DataError, match=message):
        compare(**given)
    assert not (tmp_path / "out").exists()


def test_data_masks_and_depths_are_the_same_from_another_working_folder(data, tmp_path, monkeypatch):
    shutil.copytree(data / "images", tmp_path / "masks")
    (tmp_path / "depths").mkdir()
    np.save(tmp_path / "depths" / f"{load_dataset(data).train[0].name}.npy", np.full((HEIGHT, WIDTH), 3.0))
    out = tmp_path / "out"
    monkeypatch.setattr("mi_dogsplat.compare.compare.all_tasks", lambda *_: [])
    for above in ("", "../"):
        monkeypatch.chdir(tmp_path / "masks" if above else tmp_path)
        config = TrainConfig("", **SETTINGS, masks=f"{above}masks", depths=f"{above}depths")
        compare(config, [os.path.relpath(data)], out, [0], ["3dgs"])
    settings = json.loads((out / "tiny" / "config.json").read_text())
    expected = {"data": data, "masks": tmp_path / "masks", "depths": tmp_path / "depths"}
    assert {name: settings[name] for name in expected} == {name: str(at.resolve()) for name, at in expected.items()}


@pytest.mark.parametrize("command", [compare_command, ablate_command])
def test_the_commands_take_masks_and_depth_maps(command):
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    given = parser.parse_args(["photos", "-o", "out", "--masks", "white", "--depths", "near"])
    assert (given.masks, given.depths) == ("white", "near")


def test_the_page_gets_the_masks_of_the_views_that_are_measured(data, tmp_path, monkeypatch):
    (tmp_path / "masks").mkdir()
    dataset = load_dataset(data, 1)
    view, grey = dataset.test[0], np.zeros((HEIGHT, WIDTH), np.uint8)
    grey[:, WIDTH // 3 :] = 255
    for named in (view, dataset.train[0]):
        Image.fromarray(grey).save(tmp_path / "masks" / f"{named.name}.png")
    given = {}
    monkeypatch.setattr("mi_dogsplat.compare.compare.all_tasks", lambda *_: [])
    page = "mi_dogsplat.compare.compare.comparison_page"
    monkeypatch.setattr(page, lambda out, table, masks: given.update(masks) or "")
    compare(TrainConfig("", **SETTINGS, masks=str(tmp_path / "masks")), [str(data)], tmp_path / "out", [0], ["3dgs"])
    np.testing.assert_array_equal(given["tiny"](view.name), grey > 0)
    assert given["tiny"]("of an earlier run") is None


def test_masks_that_leave_nothing_to_compare_are_told_before_any_training(data, tmp_path):
    (tmp_path / "masks").mkdir()
    (view,) = load_dataset(data, 1).test
    Image.new("L", (4, 3)).save(tmp_path / "masks" / f"{view.name}.png")
    Image.new("L", (4, 3), 255).save(tmp_path / "masks" / f"{load_dataset(data, 1).train[0].name}.png")
    with pytest.raises(DataError, match="masks: is black in every view that is measured"):
        compare(TrainConfig("", **SETTINGS, masks=str(tmp_path / "masks")), [str(data)], tmp_path / "out")
    assert not (tmp_path / "out").exists()
