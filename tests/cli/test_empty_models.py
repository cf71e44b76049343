"""A model without primitives: every command that makes something of a model says so, and makes nothing."""

import pytest
from command_line import assert_one_line, run
from mi_dogsplat import Splats, write_ply

COMMANDS = {
    "render": ["-o", "{out}/view.png"],
    "film": ["-o", "{out}/film.mp4", "--size", "32", "32", "--seconds", "0.1"],
    "eval": ["{data}", "-o", "{out}"],
    "check": ["-o", "{out}", "--only", "work-precision", "--rounds", "1"],
    "export": ["-o", "{out}/model.spz"],
    "simplify": ["-o", "{out}/small.ply", "--target", "10%"],
    "clean": ["-o", "{out}/lean.ply"],
    "mesh": ["-o", "{out}/surface.ply"],
    "masks": ["{data}", "-o", "{out}/masks"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_of_an_empty_model_nothing_is_made(capsys, data, tmp_path, monkeypatch, command):
    monkeypatch.setattr("mi_dogsplat.check.run.synthetic_scenes", lambda _: [])
    model, out = tmp_path / "empty.ply", tmp_path / "out"
    out.mkdir()
    write_ply(model, Splats.empty(1))
    words = [word.format(data=data, out=out) for word in COMMANDS[command]]
    assert_one_line(run(capsys, command, model, *words), f"{model}: the model is empty; ", " one that has primitives")
    assert not list(out.iterdir())
