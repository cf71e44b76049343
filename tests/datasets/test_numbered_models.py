"""Several models of one capture, as COLMAP writes them where it cannot connect all images."""

import pytest
from command_line import assert_one_line, run
from dataset_folders import N_VIEWS, colmap_folder, error_of
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.numbered_models import numbered_models, other_models
from mi_dogsplat.poses.input import needs_poses


@pytest.mark.parametrize("text", [True, False], ids=["text", "binary"])
def test_what_is_in_other_models_is_told_and_how_to_read_a_larger_one(tmp_path, text, capsys):
    colmap_folder(tmp_path, "sparse/0")
    assert other_models(tmp_path) == []
    for number in (2, 10):
        colmap_folder(tmp_path, f"sparse/{number}", text)
    first = tmp_path / "sparse" / "0" / "images.txt"
    first.write_text("\n".join(first.read_text().splitlines()[-4:]))
    assert [folder.name for folder in numbered_models(tmp_path)] == ["0", "2", "10"]
    lines = other_models(tmp_path)
    assert [line.split(",")[0] for line in lines] == ["sparse/2", "sparse/10"]
    assert f"of {N_VIEWS} images; the one that is read has 2: give {tmp_path / 'sparse' / '2'} to read" in lines[0]
    assert len(load_dataset(tmp_path / "sparse" / "2").views) == N_VIEWS
    _, printed, _ = run(capsys, "info", tmp_path)
    assert all(line in printed for line in lines)


def test_a_larger_model_that_is_read_is_not_to_be_replaced(tmp_path):
    colmap_folder(tmp_path, "sparse/0")
    colmap_folder(tmp_path, "sparse/1")
    (line,) = other_models(tmp_path)
    assert line.endswith(f"the one that is read has {N_VIEWS}")


@pytest.mark.parametrize("command", ["info", "train"])
def test_poses_are_not_looked_for_where_there_is_a_model_of_another_number(tmp_path, capsys, command):
    colmap_folder(tmp_path / "data", "sparse/1")
    assert not needs_poses(tmp_path / "data")
    expected = f"has a COLMAP model in sparse/1, and none in sparse/0; give {tmp_path / 'data' / 'sparse' / '1'}"
    assert expected in error_of(tmp_path / "data")
    more = [] if command == "info" else ["-o", tmp_path / "run"]
    assert_one_line(run(capsys, command, tmp_path / "data", *more), expected)
    assert not (tmp_path / "run").exists()
