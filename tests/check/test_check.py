"""``dogsplat check``: its curves of runs, its files, its command line."""

import json
import sys
from pathlib import Path
from typing import Any

import mi_dogsplat
import numpy as np
import pytest
import tiny_data
from check_report import REPORT, figures
from html_pages import parsed
from mi_dogsplat import write_ply
from mi_dogsplat.check import curves, scenes, stability
from mi_dogsplat.check.curves import GROUPS
from mi_dogsplat.check.run import check
from mi_dogsplat.check.training import read_training
from mi_dogsplat.cli import main
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from own_axes_models import CURVED, CUT, SECOND_CUT, SHIFTED, SLOPED

TEMPLATES = Path(mi_dogsplat.__file__).parent / "report" / "templates"


def run(capsys, *argv) -> tuple[int, str, str]:
    """(exit status, stdout, stderr)"""
    try:
        status = main([str(argument) for argument in ("check", *argv)])
    except SystemExit as stop:
        status = stop.code
    captured = capsys.readouterr()
    return int(status or 0), captured.out, captured.err


@pytest.fixture
def finished_run(tmp_path) -> Path:
    folder = tmp_path / "run"
    folder.mkdir()
    rows = [{"step": s, "seconds": s / 10, "l1": 1 / s, "n": 10 + s, "n_dog": 0} for s in range(10, 110, 10)]
    rows[4] |= {"test_psnr": 22.0, "test_flip": 0.2}
    (folder / "history.jsonl").write_text("\n".join(map(json.dumps, rows)))
    (folder / "config.json").write_text('{"data": "/data/fox", "preset": "ours"}')
    metrics = {"test": {"psnr": 25.0, "flip": 0.1, "ssim": 0.9, "l1": 0.02}, "train_seconds": 10.5}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    return folder


@pytest.fixture
def few_points(monkeypatch):
    """Every setting is a kernel to compile."""
    monkeypatch.setattr(curves, "ALPHA", {"1/64": 1 / 64, "1/255": 1 / 255})
    monkeypatch.setattr(curves, "KEPT", {"100 %": 1.0, "50 %": 0.5})
    for name in ("TRANSMITTANCE", "BOUND", "PATCH"):
        monkeypatch.setattr(curves, name, {})


# --- training ---


def test_the_curves_of_a_run_end_with_what_it_measured_in_the_end(finished_run):
    (of_run,) = read_training([finished_run])
    assert of_run["label"] == "fox · preset ours" and of_run["seconds"] == 10.5 and of_run["n"] == 110
    assert of_run["psnr"] == [[5.0, 22.0], [10.5, 25.0]] and of_run["flip"] == [[5.0, 0.2], [10.5, 0.1]]
    assert of_run["l1"][0] == [1.0, 0.1] and len(of_run["l1"]) == 10
    assert of_run["final"]["ssim"] == 0.9


def test_the_primitives_of_a_run_are_those_of_its_model(finished_run):
    """What has faded is in the last row of the history, and left out of the model."""
    metrics = json.loads((finished_run / "metrics.json").read_text())
    (finished_run / "metrics.json").write_text(json.dumps(metrics | {"n": 108}))
    assert read_training([finished_run])[0]["n"] == 108


def test_a_run_that_read_no_test_view_says_which_it_measured(finished_run):
    (finished_run / "config.json").write_text('{"data": "/data/fox", "preset": "ours", "split": "validation"}')
    assert read_training([finished_run])[0]["label"] == "fox · preset ours · validation views"


def test_an_interrupted_run_has_curves_too_and_equal_names_are_told_apart(finished_run):
    (finished_run / "metrics.json").unlink()
    first, second = read_training([finished_run, finished_run])
    assert first["psnr"] == [[5.0, 22.0]] and first["seconds"] == 10.0 and first["final"] == {}
    assert str(finished_run) in first["label"]


def test_runs_that_cannot_be_compared_are_named(tmp_path, finished_run):
    with pytest.raises(DataError, match="nowhere: no such folder"):
        read_training([tmp_path / "nowhere"])
    with pytest.raises(DataError, match="no history.jsonl with a logged step"):
        read_training([tmp_path])
    with pytest.raises(DataError, match="--runs: 8 runs are given; compare at most 7"):
        read_training([finished_run] * 8)


# --- the command ---


def test_work_precision_of_a_model_from_a_camera_file(capsys, model, tmp_path, monkeypatch, few_points):
    for name in ("_dense", "_faint", "_needles"):
        monkeypatch.setattr(scenes, name, lambda rng: tiny_data.truth())
    write_camera(tmp_path / "c.json", tiny_data.cameras()[0])
    out = tmp_path / "new" / "out"
    flags = ["--only", "work-precision", "--width", 32, "--rounds", 1, "--camera", tmp_path / "c.json"]
    status, printed, err = run(capsys, model, "-o", out, *flags, "--background", "white")
    assert status == 0 and err == "" and printed.splitlines()[-1] == str(out / "check.html")
    report = json.loads((out / "check.json").read_text())
    assert report["model_name"] == "model.ply" and set(report) == {"model_name", "machine", "work_precision"}
    assert len(report["work_precision"]) == 4
    scene = report["work_precision"][-1]
    assert (scene["name"], scene["n"], scene["width"], scene["height"]) == ("model.ply", 60, 32, 24)
    exact = next(r for r in scene["rows"] if r["setting"] == "no cutoffs")
    assert exact["mean_error"] < 1e-6 and 0 < exact["forward_ms"] and 0 < exact["total_ms"]
    html = (out / "check.html").read_text(encoding="utf-8")
    parsed(html)
    assert len(figures(html)) == 8 and "60 primitives, 0 of them DoG, SH degree 1; 32 x 24 pixels" in html
    assert sorted(p.name for p in out.iterdir()) == ["check.html", "check.json"]


def test_a_model_is_framed_when_no_camera_is_named(capsys, model, tmp_path, monkeypatch, few_points):
    monkeypatch.setattr("mi_dogsplat.check.run.synthetic_scenes", lambda width: [])
    flags = ["--only", "work-precision", "--width", 32, "--rounds", 1]
    assert run(capsys, model, "-o", tmp_path / "out", *flags)[0] == 0
    (scene,) = json.loads((tmp_path / "out" / "check.json").read_text())["work_precision"]
    whole = next(r for r in scene["rows"] if r["setting"] == "50 %")
    assert whole["mean_error"] > 1e-3  # it is in view


@pytest.mark.skipif(sys.platform != "linux", reason="needs a file system whose names are bytes, as Linux has it")
def test_a_model_whose_name_is_no_utf_8_has_a_page(capsys, model, tmp_path, monkeypatch, few_points):
    monkeypatch.setattr("mi_dogsplat.check.run.synthetic_scenes", lambda width: [])
    path = tmp_path / "caf\udce9.ply"  # é of Latin-1, as Python has it
    path.write_bytes(model.read_bytes())
    assert run(capsys, path, "-o", tmp_path, "--only", "work-precision", "--width", 16, "--rounds", 1)[0] == 0
    assert "caf\\udce9.ply" in (tmp_path / "check.html").read_text(encoding="utf-8")


def test_every_curve_has_a_colour_and_a_marker_of_its_own():
    style = (TEMPLATES / "style.css").read_text(encoding="utf-8")
    for number in range(1, len(GROUPS) + 1):
        assert f".c{number}, .k{number} {{ --of: var(--c{number}); }}" in style and style.count(f"--c{number}: #") == 2
    parts = (TEMPLATES / "parts.html").read_text(encoding="utf-8")
    shapes = [line for line in parts.partition("SHAPES = [")[2].partition("]")[0].splitlines() if line]
    assert len(set(shapes)) == len(shapes) == len(GROUPS) + 1  # and what is in no group


@pytest.mark.parametrize(
    ("kind", "truth", "said", "color"),
    [
        (SLOPED, tiny_data.sloped_truth, "with slopes", "c8"),
        (CURVED, tiny_data.curved_truth, "with curvatures", "c9"),
        (CUT, tiny_data.cut_truth, "with a cut", "c10"),
        (SECOND_CUT, tiny_data.twice_cut_truth, "with a second cut", "c11"),
        (SHIFTED, tiny_data.shifted_truth, "with shifts", "c12"),
    ],
    ids=["slopes", "curvatures", "cuts", "second cuts", "shifts"],
)
@pytest.mark.usefixtures("small_blocks")
def test_a_model_with_rows_is_measured_with_theirs(kind, truth, said, color, capsys, tmp_path, monkeypatch, few_points):
    monkeypatch.setattr("mi_dogsplat.check.run.synthetic_scenes", lambda width: [])
    splats, name = truth(), kind.word.replace("_", " ")
    write_ply(tmp_path / "model.ply", splats)
    flags = ["--only", "work-precision", "--width", 32, "--rounds", 1]
    assert run(capsys, tmp_path / "model.ply", "-o", tmp_path / "out", *flags)[0] == 0
    (scene,) = json.loads((tmp_path / "out" / "check.json").read_text())["work_precision"]
    rows = {row["setting"]: row for row in scene["rows"]}
    assert scene[f"n_{kind.word}"] == kind.n(splats) and rows["no cutoffs"]["mean_error"] < 1e-6
    assert rows["no cutoffs"]["gradient_error"][kind.name] < 1e-4
    assert rows[f"without {name}"]["mean_error"] > 2 * rows[f"with {name}"]["mean_error"]
    html = (tmp_path / "out" / "check.html").read_text(encoding="utf-8")
    parsed(html)
    assert f"{kind.n(splats)} {said}" in html and f"without {name}" in html and f'class="{color} points"' in html


def test_training_of_two_runs(capsys, finished_run, tmp_path):
    out = tmp_path / "out"
    status, printed, _ = run(capsys, "-o", out, "--only", "training", "--runs", finished_run, finished_run)
    assert status == 0 and printed == f"{out / 'check.html'}\n"
    assert set(json.loads((out / "check.json").read_text())) == {"model_name", "machine", "training"}
    assert len(figures((out / "check.html").read_text())) == 3


def test_a_stability_case_that_is_wrong_is_one_line_and_exit_code_1(capsys, tmp_path, monkeypatch):
    rows = REPORT["stability"]
    monkeypatch.setattr(stability, "run", lambda progress: rows)
    status, _, err = run(capsys, "-o", tmp_path, "--only", "stability")
    assert status == 1 and err == "dogsplat: stability: 1 wrong: lens\n"
    assert json.loads((tmp_path / "check.json").read_text())["stability"] == rows
    monkeypatch.setattr(stability, "run", lambda progress: rows[:1])
    assert run(capsys, "-o", tmp_path, "--only", "stability")[::2] == (0, "")


def test_all_parts_but_training_are_run_by_default(capsys, tmp_path, monkeypatch):
    row = {"name": "a", "image_error": np.float32(np.inf), "max_T": np.float32(2), "verdict": "right"}
    monkeypatch.setattr(stability, "run", lambda progress: [row])
    monkeypatch.setattr("mi_dogsplat.check.run.synthetic_scenes", lambda width: [])
    assert run(capsys, "-o", tmp_path)[0] == 0
    report = json.loads((tmp_path / "check.json").read_text())
    assert set(report) == {"model_name", "machine", "work_precision", "stability"}
    assert report["stability"] == [row | {"image_error": None, "max_T": 2.0}]  # no NaN or infinity in a file


def test_bad_runs_are_found_before_hours_of_work(tmp_path, monkeypatch):
    monkeypatch.setattr(stability, "run", lambda progress: pytest.fail("too late"))
    with pytest.raises(DataError, match="no such folder"):
        check(tmp_path / "out", runs=[tmp_path / "nowhere"])
    assert not (tmp_path / "out").exists()


def test_what_changes_no_number_of_a_model_is_refused(model, tmp_path):
    for options, flag in ((PictureOptions(linear=True), "--linear"), (PictureOptions(white=2.0), "--white")):
        with pytest.raises(DataError, match=f"{flag}: changes no number that is measured"):
            check(tmp_path / "out", model, options=options)
    assert not (tmp_path / "out").exists()


def test_bad_input_is_one_line_that_names_it(capsys, model, tmp_path):
    write_ply(tmp_path / "empty.ply", Splats.empty(0))
    (tmp_path / "bad.ply").write_text("ply\nnonsense\n")
    out = tmp_path / "out"
    for argv, *expected in [
        (["-o", out, "--only", "cooking"], "--only", "cooking", "stability"),
        (["-o", out, "--only", "training"], "--runs"),
        (["-o", out, "--only", "stability", "--runs", tmp_path], "--runs", "add training to --only"),
        (["-o", out, "--runs", tmp_path / "nowhere"], "nowhere", "no such folder"),
        ([model, "-o", out, "--only", "stability"], "model.ply", "work-precision"),
        ([tmp_path / "missing.ply", "-o", out], "missing.ply"),
        ([tmp_path / "bad.ply", "-o", out], "bad.ply"),
        ([tmp_path / "empty.ply", "-o", out], "empty.ply", "the model is empty"),
        ([model, "-o", out, "--camera", "0"], "--data"),
        (["-o", out, "--only", "stability", "--data", "photos"], "--data: says from where a model is seen"),
        (["-o", out, "--only", "stability", "--camera", "0"], "--camera: says from where a model is seen"),
        (["-o", out, "--near-clip", "0"], "--near-clip: says how a model is drawn, but no model is given"),
        (["-o", out, "--background", "white"], "--background: says how a model is drawn, but no model is given"),
        ([model, "-o", out, "--white", "2"], "unrecognized arguments: --white"),
        ([model, "-o", out, "--camera", tmp_path / "no.json"], "no.json"),
        ([model, "-o", out, "--width", 3], "--width", "3", "16"),
        ([model, "-o", out, "--rounds", 0], "--rounds"),
        ([model, "-o", out, "--background", "pink"], "pink"),
        (["-o", model, "--only", "stability"], "model.ply"),
        (["-o", model / "out", "--only", "stability"], "model.ply"),
        ([model], "-o", "--help"),
    ]:
        status, printed, err = run(capsys, *argv)
        assert status == 2 and printed == "" and err.startswith("dogsplat: ") and err.count("\n") == 1, (argv, err)
        assert all(word in err for word in expected), (expected, err)
    assert not out.exists()


@pytest.mark.parametrize("name", ["parts", "runs"])
def test_a_name_in_place_of_a_list_is_not_taken_letter_by_letter(tmp_path, name):
    given: dict[str, Any] = {name: "training"}
    with pytest.raises(DataError, match=f'^check: {name}: "training" is no list; give one, as {name}=."training".$'):
        check(tmp_path / "checked", **given)
    assert not (tmp_path / "checked").exists()
