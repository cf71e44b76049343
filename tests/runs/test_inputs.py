"""What a run reads is never what it replaces or removes."""

from pathlib import Path

import pytest
from command_line import assert_one_line, run
from mi_dogsplat.runs.inputs import require_apart
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
            require_apart(TrainConfig("photos", model=model), Path("run"))
    require_apart(TrainConfig("photos", model="run/kept.ply"), Path("run"))
    require_apart(TrainConfig("photos", model=f"run/point_cloud.{format}"), Path("other"))


@pytest.mark.parametrize("data", ["run/refined", "run/refined/transforms.json"])
def test_a_run_does_not_remove_the_data_that_it_begins_with(tmp_path, monkeypatch, data):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match=r"^run: is the run that its data come from; name another folder"):
        require_apart(TrainConfig(data), Path("run"))
    require_apart(TrainConfig("run/posed"), Path("run"))
    require_apart(TrainConfig(data), Path("other"))


def test_the_model_of_a_run_survives_a_prune_into_it(data, tmp_path, capsys):
    run_folder = tmp_path / "run"
    run_folder.mkdir()
    (run_folder / "config.json").write_text("{}")
    write_ply(model := run_folder / "point_cloud.ply", truth())
    result = run(capsys, "prune", model, data, "-o", run_folder, "--steps", "1")
    assert_one_line(result, "is the run that its model comes from")
    assert {path.name for path in run_folder.iterdir()} == {"config.json", "point_cloud.ply"}
