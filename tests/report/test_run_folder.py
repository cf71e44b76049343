"""What is read of a run folder: settings that a hand or a disk has damaged are told in one line."""

import json
from pathlib import Path

import pytest
import tiny_data
from command_line import assert_one_line
from command_line import run as dogsplat
from mi_dogsplat import write_ply
from mi_dogsplat.report.run_folder import read_run
from mi_dogsplat.report.write import write_report
from mi_dogsplat.support.errors import DataError

WRONG = {
    "data": [[1], {}, None, 7],
    "preset": [["ours"], None],
    "split": [1, ["test"]],
    "downscale": ["2", 0, -1, 1.5, True, None, []],
    "data_on_disk": ["no", 1, None],
    "background": [{}, ["white"], None, 1],
    "antialiased": ["x", 1, []],
    "near_clip": ["x", -1, [], True, float("nan")],
    "white": [[], "1", 0, -2.0, float("inf")],
    "up": [1, ["y"], "upwards", {}],
    "unit": ["m", [], 0, False],
}
RIGHT = {
    "data": ["photos", ""],
    "preset": ["ours", "of another version"],
    "downscale": [1, 8],
    "background": ["random"],
    "antialiased": [True, False],
    "near_clip": [None, 0, 0.25],
    "white": [None, 3, 0.5],
    "up": [None, "-y", "0.1,-0.9,0.4"],
    "unit": [None, 1, 0.3],
    "of_another_version": [{"a": []}],
    "seed": ["shown, and nothing more"],
}


def write(folder: Path, config: dict) -> Path:
    (folder / "config.json").write_text(json.dumps(config))
    return folder


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in WRONG.items() for value in values])
def test_a_setting_that_no_run_writes_is_one_line(tmp_path, name, value):
    with pytest.raises(DataError, match=f'config.json: "{name}" is not what a run writes; restore or delete it'):
        read_run(write(tmp_path, {"steps": 7, name: value}))


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in RIGHT.items() for value in values])
def test_what_a_run_of_any_version_writes_is_read(tmp_path, name, value):
    assert read_run(write(tmp_path, {name: value})).config == {name: value}


@pytest.mark.parametrize(
    ("data", "source", "name"),
    [
        ("run/posed", "/home/me/fox photos/", "fox photos"),
        ("run\\posed", "walk.mp4", "walk.mp4"),
        ("posed_by_hand", "photos", "posed_by_hand"),
        ("run/posed", None, "posed"),
    ],
)
def test_a_report_is_headed_by_the_photographs_that_were_named(tmp_path, data, source, name):
    (tmp_path / "posed").mkdir()
    (tmp_path / "posed" / "poses.json").write_text(json.dumps({"source": source}))
    assert read_run(write(tmp_path, {"data": data})).data_name == name
    assert f"<h1>{name}" in write_report(tmp_path).read_text(encoding="utf-8")


@pytest.mark.parametrize("command", ["film", "view", "info"])
@pytest.mark.parametrize("config", [{"near_clip": "x"}, {"white": []}, {"background": {}}], ids=str)
def test_commands_that_show_a_run_say_so(tmp_path, capsys, command, config):
    write_ply(tmp_path / "point_cloud.ply", tiny_data.truth())
    out = ("-o", tmp_path / "film") if command == "film" else ()
    result = dogsplat(capsys, command, write(tmp_path, config), *out)
    assert_one_line(result, str(tmp_path / "config.json"), f'"{next(iter(config))}"', "restore or delete it")
