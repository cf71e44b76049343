"""What a run reads is never what it replaces or removes, and has a path that its files can hold."""

from dataclasses import replace
from pathlib import Path

import pytest
from command_line import assert_one_line, run
from mi_dogsplat.runs.inputs import check_inputs
from mi_dogsplat.runs.run import train, train_until
from mi_dogsplat.scene.ply import write_ply
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.config import FORMATS, TrainConfig
from tiny_data import truth


@pytest.mark.parametrize("format", FORMATS)
def test_a_run_does_not_replace_the_model_that_it_begins_with(tmp_path, monkeypatch, format):
    monkeypatch.chdir(tmp_path)
    Path("run").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "run", target_is_directory=True)
    for model in (f"run/point_cloud.{format}", f"link/../run/point_cloud.{format}", f"link/point_cloud.{format}"):
        with pytest.raises(DataError, match=r"^run: is the run that its model comes from; name another folder"):
            check_inputs(TrainConfig("photos", model=model), Path("run"))
    check_inputs(TrainConfig("photos", model="run/kept.ply"), Path("run"))
    check_inputs(TrainConfig("photos", model=f"run/point_cloud.{format}"), Path("other"))


@pytest.mark.parametrize("data", ["run/refined", "run/refined/transforms.json"])
def test_a_run_does_not_remove_the_data_that_it_begins_with(tmp_path, monkeypatch, data):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match=r"^run: is the run that its data come from; name another folder"):
        check_inputs(TrainConfig(data), Path("run"))
    check_inputs(TrainConfig("run/posed"), Path("run"))
    check_inputs(TrainConfig(data), Path("other"))


def test_the_model_of_a_run_survives_a_prune_into_it(data, tmp_path, capsys):
    run_folder = tmp_path / "run"
    run_folder.mkdir()
    (run_folder / "config.json").write_text("{}")
    write_ply(model := run_folder / "point_cloud.ply", truth())
    result = run(capsys, "prune", model, data, "-o", run_folder, "--steps", "1")
    assert_one_line(result, "is the run that its model comes from")
    assert {path.name for path in run_folder.iterdir()} == {"config.json", "point_cloud.ply"}


@pytest.mark.parametrize("name", ["data", "masks", "depths", "model"])
def test_a_path_that_no_json_holds_is_refused_before_the_training(tmp_path, name):
    config = replace(TrainConfig("photos"), **{name: "caf\udce9/in"})  # é of Latin-1, as Python has it
    with pytest.raises(DataError, match=r"its path is not UTF-8, which config\.json needs; rename it"):
        train(config, tmp_path / "run")
    with pytest.raises(DataError, match="its path is not UTF-8"):
        train_until(config, tmp_path / "run", 1)
    assert not (tmp_path / "run").exists()
