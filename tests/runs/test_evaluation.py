"""A model measured on photographs: the folder that it fills is whole, or not there."""

import json

import pytest
import tiny_data
from mi_dogsplat import write_ply
from mi_dogsplat.inspection.dataset import describe_dataset
from mi_dogsplat.measure.evaluate import evaluate_views, view_files
from mi_dogsplat.runs import evaluation
from mi_dogsplat.runs.evaluation import evaluate_model
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.locks import locked


def written(out, views) -> set:
    """The files of views without masks."""
    return {path for view in views for path in view_files(out, view) if path.name != f"{view}_mask.png"}


def test_a_measurement_that_is_stopped_leaves_nothing_and_can_be_begun_again(tmp_path, monkeypatch):
    data, model, out = tiny_data.write_tiny_data(tmp_path / "data", n=17), tmp_path / "model.ply", tmp_path / "out"
    write_ply(model, tiny_data.truth())
    picture_of, drawn = evaluation.picture_of, []

    def stopping(*given, **how):
        picture = picture_of(*given, **how)

        def stopped_at_the_second(camera):
            drawn.append(camera)
            if len(drawn) % 2 == 0:
                raise KeyboardInterrupt
            return picture(camera)

        return stopped_at_the_second

    for _ in range(2):  # before there is anything, and where it was measured already
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(evaluation, "picture_of", stopping)
            evaluate_model(model, data, out)
        assert not out.exists()
        views = evaluate_model(model, data, out)
        assert len(views) == 3 and json.loads((out / "metrics.json").read_text())["views"] == views
        assert {*out.iterdir()} == {out / "metrics.json", *written(out, views)}


def test_a_measurement_that_is_killed_leaves_no_metrics_of_before_and_can_be_begun_again(data, tmp_path, monkeypatch):
    write_ply(model := tmp_path / "model.ply", tiny_data.truth())
    out, seen = tmp_path / "out", []

    def look(*given, **how):
        seen.append((out / "metrics.json").read_text())
        return evaluate_views(*given, **how)

    monkeypatch.setattr(evaluation, "evaluate_views", look)
    out.mkdir()
    (out / "metrics.json").write_text('{"test": {"psnr": 99}}')
    (out / ".0.png.0123456789ab.part").write_bytes(b"half a picture, of a process that was killed")
    evaluate_model(model, data, out)
    assert json.loads(seen[0]) == {} and not [*out.glob(".*")]


def test_pictures_of_views_that_are_not_measured_again_do_not_stay(tmp_path):
    write_ply(model := tmp_path / "model.ply", tiny_data.truth())
    out, data = tmp_path / "out", [tiny_data.write_tiny_data(tmp_path / str(n), n=n) for n in (17, 9)]
    before, after = ({*evaluate_model(model, folder, out)} for folder in data)
    assert before - after
    assert {*out.iterdir()} == {out / "metrics.json", *written(out, after)}


@pytest.mark.parametrize("metrics", ['{"views": {"../kept": {}}}', '{"views": ["kept"]}', "[]", "{"])
def test_metrics_of_others_take_no_file_away(data, tmp_path, metrics):
    write_ply(model := tmp_path / "model.ply", tiny_data.truth())
    out = tmp_path / "out"
    out.mkdir()
    (out / "metrics.json").write_text(metrics)
    kept = [tmp_path / "kept.png", out / "kept.png"]
    for file in kept:
        file.touch()
    evaluate_model(model, data, out)
    assert all(file.is_file() for file in kept)


def test_two_measurements_do_not_write_to_one_folder_at_a_time(data, tmp_path):
    write_ply(model := tmp_path / "model.ply", tiny_data.truth())
    out = tmp_path / "out"
    out.mkdir()
    with locked(out, "another"), pytest.raises(DataError, match="another process is measuring into it"):
        evaluate_model(model, data, out)


def test_means_without_test_views_are_of_training_views(tmp_path):
    data, model = tiny_data.write_tiny_data(tmp_path / "data", n=1), tmp_path / "model.ply"
    write_ply(model, tiny_data.truth())
    (view,) = evaluate_model(model, data, tmp_path / "out").values()
    assert json.loads((tmp_path / "out" / "metrics.json").read_text()).items() >= {"train": view}.items()
    assert "100% of the points are inside the image" in "\n".join(describe_dataset(data))
