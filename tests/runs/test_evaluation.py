"""A model measured on photographs: the folder that it fills is whole, or not there."""

import json

import pytest
import tiny_data
from mi_dogsplat import write_ply
from mi_dogsplat.measure.evaluate import view_files
from mi_dogsplat.runs import evaluation
from mi_dogsplat.runs.evaluation import evaluate_model


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
        assert {*out.iterdir()} == {out / "metrics.json", *(path for view in views for path in view_files(out, view))}
