"""``--up``, ``--scale``, ``--unit`` and ``--upright``: what they say ends in runs and models."""

import json
from dataclasses import replace

import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat import Drawing, Model, read_model, write_model
from mi_dogsplat.scene.orientation import up_vector

SMALL = ["--preset", "3dgs", "--steps", "2", "--sh-degree", "0", "--max-primitives", "70", "--variant", "llvm_ad_rgb"]
TILTED = "0.36,-0.8,0.48"
CENTRE = f"{tiny_data.WIDTH / 2:g},{tiny_data.HEIGHT / 2:g}"  # where every camera sees the origin


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("world") / "model.ply"
    write_model(path, Model(tiny_data.truth(), Drawing(near_clip=0.1)))
    return path


def said(path) -> tuple:
    drawing = read_model(path).drawing
    return drawing.up, drawing.scale


def test_a_run_and_its_model_say_what_the_cameras_tell_and_a_known_length(capsys, data, tmp_path):
    ends = "0", f"1:{CENTRE}+3:{CENTRE}"  # a camera, and the origin that it looks at
    status, _, err = run(capsys, "train", data, "-o", tmp_path / "run", *SMALL, "--scale", *ends, "1.5")
    assert status == 0, err
    unit = 1.5 / np.linalg.norm(tiny_data.cameras()[0].position)
    up, scale = said(tmp_path / "run" / "point_cloud.ply")
    config = json.loads((tmp_path / "run" / "config.json").read_text())
    assert up == config["up"] == "z" and scale == config["unit"] == pytest.approx(unit, rel=1e-6)
    assert config["scale"] == [*ends, "1.5"]


def test_flags_come_before_what_a_model_says(capsys, model, data, tmp_path):
    out = tmp_path / "a.ply"
    assert run(capsys, "clean", model, "-o", out, f"--up={TILTED}", "--unit", 0.5)[0] == 0
    assert said(out) == (TILTED, 0.5) and np.array_equal(read_model(out).splats.means, read_model(model).splats.means)
    assert run(capsys, "clean", out, "-o", tmp_path / "b.ply", "--up", "z")[0] == 0
    assert said(tmp_path / "b.ply") == ("z", 0.5)
    assert run(capsys, "export", out, "-o", tmp_path / "d.ply", "--views", 0)[0] == 0  # nor does that turn any number
    assert np.array_equal(read_model(tmp_path / "d.ply").splats.means, read_model(model).splats.means)
    apart = np.linalg.norm(tiny_data.cameras()[0].position - tiny_data.cameras()[4].position)
    measured = "--data", data, "--scale", "0", "4", "3", "--views", 0
    assert run(capsys, "export", out, "-o", tmp_path / "c.glb", *measured)[0] == 0
    assert said(tmp_path / "c.glb") == (TILTED, pytest.approx(3 / apart, rel=1e-6))


@pytest.mark.parametrize("command", ["clean", "export"])
def test_what_the_data_say_comes_after_what_a_model_says(capsys, model, tmp_path, command):
    data, more = tiny_data.write_tiny_data(tmp_path / "data"), ["--views", 0] if command == "export" else []
    (data / "world.json").write_text(json.dumps({"up": "x", "scale": 2.0}))
    own = tmp_path / "own.ply"
    write_model(own, replace(read_model(model), drawing=Drawing(up=TILTED)))
    for source, expected in ((model, ("x", 2.0)), (own, (TILTED, 2.0))):
        assert run(capsys, command, source, "-o", tmp_path / "a.ply", "--data", data, *more)[0] == 0
        assert said(tmp_path / "a.ply") == expected
    assert run(capsys, command, model, "-o", tmp_path / "b.ply", "--data", data, "--upright", *more)[0] == 0
    assert said(tmp_path / "b.ply") == ("-y", 1.0)


@pytest.mark.parametrize("command", ["clean", "export"])
def test_upright_turns_the_numbers_themselves(capsys, model, tmp_path, command):
    out, more = tmp_path / "a.spz", ["--views", 1, "--refine", 0] if command == "export" else []
    status, printed, err = run(capsys, command, model, "-o", out, f"--up={TILTED}", "--unit", 2, "--upright", *more)
    assert status == 0 and "cannot say" not in printed, err
    before, after = read_model(model).splats, read_model(out).splats
    highest = before.means @ up_vector(TILTED)
    assert np.ptp(after.means[:, 1]) == pytest.approx(2 * np.ptp(highest), rel=1e-3)
    assert after.means[:, 1].min() == pytest.approx(-2 * highest.max(), abs=1e-3)
    if command == "export":  # compared with the model as it lies
        assert float(printed.split("read from the file")[1].split()[0]) > 30


def test_bad_worlds_are_one_line(capsys, model, data, tmp_path):
    cases = {
        ("--up", "up"): '--up: "up" is not a direction',
        ("--unit", "0"): "--unit: 0.0 is out of range",
        ("--scale", "0", "1", "-2"): '--scale: "-2" is not a length',
        ("--scale", "0", "1", "2"): "--scale: needs the cameras of a data set",
        ("--data", data, "--scale", "0", "nobody", "2"): '--scale: no image "nobody" has a pose',
        ("--data", data, "--scale", "a", "b", "2", "--unit", "3"): "--scale: says the same as --unit",
        ("--upright",): "--upright: nothing says what is up in the model",
    }
    for flags, line in cases.items():
        assert_one_line(run(capsys, "clean", model, "-o", tmp_path / "a.ply", *flags), line)
    both = "--scale", "0", "4", "2", "--unit", "3"
    assert_one_line(run(capsys, "train", data, "-o", tmp_path / "run", *SMALL, *both), "--scale: says the same")
    both = run(capsys, "export", model, "-o", tmp_path / "a.spz", "--small", "--up=-y", "--upright")
    assert_one_line(both, "make it upright first: dogsplat clean")
