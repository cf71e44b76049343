"""``dogsplat check``: its page, its files, its command line."""

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pytest
import tiny_data
from html_pages import parsed, rows, section, words
from mi_dogsplat import write_ply
from mi_dogsplat.check import scenes, stability
from mi_dogsplat.check import settings as settings_module
from mi_dogsplat.check.page import check_page
from mi_dogsplat.check.run import check
from mi_dogsplat.check.tables import cell, table
from mi_dogsplat.check.training import read_training
from mi_dogsplat.cli import main
from mi_dogsplat.report.page import TEMPLATES
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError


def row(group: str, setting: str, ms: float, error: float, **others) -> dict:
    return {
        "group": group, "setting": setting, "default": False, "forward_ms": ms, "total_ms": 3 * ms,
        "mean_error": error, "max_error": 9 * error, "psnr": 60.0, "rounding_error": 1e-7,
        "gradient_error": {"means": error, "quats": 2 * error}, "worst_gradient_error": 2 * error,
        "image_front": False, "gradient_front": False, **others,
    }  # fmt: skip


REPORT = {
    "model_name": "fox & friends.ply",
    "machine": {"variant": "llvm_ad_rgb", "cores": 2, "load": 0.1},
    "work_precision": [
        {
            "name": "a < b", "what": "few primitives", "width": 64, "height": 48, "n": 9, "n_dog": 0,
            "rows": [
                row("", "default", 5.0, 1e-3, default=True, image_front=True),
                row("", "no cutoffs", 9.0, 1e-7, image_front=True, gradient_front=True),
                row("alpha cutoff", "1/64", 4.0, 4e-3, image_front=True),
                row("alpha cutoff", "1/255", 5.0, 1e-3, default=True, image_front=True),
                row("bound", "16", 5.5, 2e-3, rounding_error=None),
                row("bound", "1", 5.0, 1e-3, default=True, image_front=True),
            ],
        }
    ],
    "training": [
        {"run": "a", "label": "fox · <3dgs>", "seconds": 100.0, "n": 3000, "final": {"psnr": 27.5, "flip": 0.1},
         "l1": [[1.0, 0.1], [99.0, 0.01]], "psnr": [[50.0, 25.0], [100.0, 27.5]], "flip": [[100.0, 0.1]]},
        {"run": "b", "label": "fox · ours", "seconds": 50.0, "n": 300, "final": {"psnr": 27.4},
         "l1": [[1.0, 0.2], [49.0, 0.02]], "psnr": [], "flip": []},
    ],
    "stability": [
        {"group": "shape", "name": "needle", "finite": True, "image_error": 3e-7, "gradient_error": {"means": 2e-6},
         "max_T": 1.0, "verdict": "right", "note": ""},
        {"group": "camera", "name": "lens", "finite": False, "image_error": None, "gradient_error": 0.5,
         "max_T": 1.0, "verdict": "wrong", "note": "a <defect>"},
    ],
}  # fmt: skip


def figures(html: str, name: str = "") -> list[str]:
    return re.findall(rf'<svg [^>]*role="img" aria-label="{name}[^>]*>.*?</svg>', html, re.DOTALL)


def page_of(report: dict) -> Element:
    return parsed(check_page(report))


def table_of(values: list[dict]) -> Element:
    """The table of a page."""
    macros: Any = TEMPLATES.get_template("check/templates/table.html").module
    return parsed(macros.table(table(values)))


def run(capsys, *argv) -> tuple[int, str, str]:
    """(exit status, stdout, stderr)"""
    try:
        status = main([str(argument) for argument in ("check", *argv)])
    except SystemExit as stop:
        status = stop.code
    captured = capsys.readouterr()
    return int(status or 0), captured.out, captured.err


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "model.ply"
    write_ply(path, tiny_data.truth())
    return path


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
    monkeypatch.setattr(settings_module, "ALPHA", {"1/64": 1 / 64, "1/255": 1 / 255})
    monkeypatch.setattr(settings_module, "KEPT", {"100 %": 1.0, "50 %": 0.5})
    for name in ("TRANSMITTANCE", "BOUND", "PATCH"):
        monkeypatch.setattr(settings_module, name, {})


# --- the page ---


def test_the_page_is_well_formed_and_needs_nothing_but_itself():
    html = check_page(REPORT)
    parsed(html)
    svgs = re.findall(r"<svg.*?</svg>", html, re.DOTALL)
    assert len(svgs) == 5 + 5  # and the swatches of the legends
    for svg in svgs:
        ElementTree.fromstring(svg)
    for word in ("<script", "<link", "http", "url(", "NaN", "None"):
        assert word not in html


def test_the_page_shows_every_part():
    html = check_page(REPORT)
    assert "<title>fox &amp; friends.ply · check</title>" in html
    page = parsed(html)
    headings = ["Error against run time", "Training error against run time", "Stability"]
    assert [words(heading) for heading in page.iter("h2")] == headings
    for heading in headings:
        part = section(page, heading)
        assert part is not None and part[0].attrib["class"] == "read"
    labels = [re.findall('aria-label="([^"]*)"', svg)[0] for svg in figures(html)]
    assert labels == [
        "mean error of the image against forward, ms", "relative error, worst gradient against forward + backward, ms",
        "training L1 against run time, s", "test PSNR, dB against run time, s", "test FLIP against run time, s",
    ]  # fmt: skip
    tiles = [words(tile) for tile in page.findall(".//*[@class='tile']")]
    assert tiles == [
        "Image error ↓ 0.001 mean, defaults, a < b", "of it rounding ↓ 1.0e−7 float32 against float64",
        "Gradient error ↓ 0.002 relative, the worst parameter", "Forward 5.0 ms 15.0 with backward",
        "Stability 2 cases 0 of them defined, 1 wrong", "Training 2 runs error against wall-clock time",
    ]  # fmt: skip
    (facts,) = page.findall(".//dl")
    assert [words(fact) for fact in facts] == ["variantllvm_ad_rgb", "cores2", "load0.1"]


def test_text_from_files_cannot_become_markup():
    html = check_page(REPORT)
    for text in ("fox &amp; friends", "a &lt; b", "&lt;3dgs&gt;", "a &lt;defect&gt;"):
        assert text in html
    assert "<3dgs>" not in html and "<defect>" not in html


def test_parts_that_were_not_run_are_left_out():
    for key in ("work_precision", "training", "stability"):
        page = page_of({"model_name": None, "machine": {}, key: REPORT[key]})
        assert len(list(page.iter("h2"))) == 1
        assert words(next(page.iter("h1"))) == "numerics check"
    assert not list(page_of({}).iter("h2"))


def test_the_front_is_ringed_named_and_joined_and_the_default_drawn_once():
    (image,) = figures(check_page(REPORT), "mean error")
    assert image.count('class="ring"') == 3  # default, no cutoffs, 1/64
    assert sorted(re.findall(r'class="note"[^>]*>([^<]*)<', image)) == ["1/64", "default", "no cutoffs"]
    assert image.count('class="c0 dashed"') == 1 and image.count('class="c0 points"') == 2
    assert "<title>alpha cutoff 1/64: 0.004, 4 ms</title>" in image
    (gradient,) = figures(check_page(REPORT), "relative error")
    assert gradient.count('class="ring"') == 1


def test_both_axes_of_the_settings_are_logarithmic():
    rows = [row("bound", str(ms), ms, 1 / ms**2) for ms in (1.0, 10.0, 100.0)]
    scene = REPORT["work_precision"][0]
    html = check_page({"work_precision": [scene | {"rows": [scene["rows"][0], *rows]}]})
    for svg in figures(html)[:2]:
        points = re.findall(r'class="c3 points" transform="translate\(([\d.]+) ([\d.]+)', svg)
        for a, b, c in zip(*np.array(points, float), strict=True):
            assert b - a == pytest.approx(c - b, abs=0.2) and abs(b - a) > 20


def test_the_table_of_a_scene_has_every_setting_and_parameter():
    (numbers,) = page_of(REPORT).iter("details")
    head, *body = rows(numbers)
    assert {"setting", "means", "quats"} <= set(head) and ["alpha cutoff"] in body
    assert [line[0] for line in body if len(line) > 1] == [
        "default", "no cutoffs", "1/64", "1/255 (default)", "16", "1 (default)"
    ]  # fmt: skip
    assert body[1][-1] == "image, gradient"


def test_an_error_of_zero_or_unknown_is_in_the_table_but_not_on_the_logarithmic_plot():
    odd = row("bound", "4", 5.0, 0.0), row("bound", "2", 5.0, 1e-3, mean_error=None, psnr=None)
    scene = REPORT["work_precision"][0]
    html = check_page({"work_precision": [scene | {"rows": [*scene["rows"], *odd]}]})
    (image,) = figures(html, "mean error")
    assert "bound 16:" in image and "bound 4:" not in image and "bound 2:" not in image
    assert {"4", "2"} <= {line[0] for line in rows(next(parsed(html).iter("details")))}


def test_a_busy_machine_is_said_to_be_one():
    assert not page_of(REPORT).findall(".//*[@class='notice']")
    (notice,) = page_of(REPORT | {"machine": {"load": 1.5}}).findall(".//*[@class='notice']")
    assert "Repeat it on a quiet machine." in words(notice)


# --- tables ---


def test_a_table_takes_whatever_columns_come():
    found = rows(table_of([{"a_b": 1, "c": "x"}, {"a_b": None, "d": True}]))
    assert found == [["a b", "c", "d"], ["1", "x", "–"], ["–", "–", "yes"]]
    assert table([]).groups == []


def test_rows_of_a_group_stand_under_its_name_once():
    found = table_of([{"group": g, "v": i} for i, g in enumerate("aab")])
    assert rows(found) == [["v"], ["a"], ["0"], ["1"], ["b"], ["2"]]
    names = [line for line in found.iter("tr") if line.get("class") == "group"]
    assert [(words(name), name[0].attrib["colspan"]) for name in names] == [("a", "1"), ("b", "1")]


def test_numbers_stand_to_the_right_and_defects_stand_out():
    found = table_of([{"n": 1.0, "verdict": "right", "finite": True}, {"n": None, "verdict": "wrong", "finite": False}])
    classes = [[(words(cell), cell.get("class")) for cell in line] for line in found.iter("tr")]
    assert classes == [
        [("n", "n"), ("verdict", None), ("finite", None)],
        [("1", "n"), ("right", None), ("yes", None)],
        [("–", "n"), ("wrong", "bad"), ("no", "bad")],
    ]


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (1.234e-7, "1.2e\u22127"), (0.0123, "0.0123"), (0.0, "0"), (4.74e18, "4.74e18"), (-2.0, "\u22122"),
        (3000, "3,000"), (float("nan"), "–"), (None, "–"), (False, "no"), ("<b>", "<b>"), ([1, 2.5], "1, 2.5"),
        (list("abcdef"), "6 values"), (1e-15, "1.0e\u221215"),
        ({"means": 1e-6, "quats": 2e-3, "x": None}, ("0.002", "quats")), ({}, "–"), (0, "0"),
    ],
)  # fmt: skip
def test_values_are_shown_short(value, shown):
    assert cell(value)[:2] == (shown if isinstance(shown, tuple) else (shown, ""))


# --- training ---


def test_the_curves_of_a_run_end_with_what_it_measured_in_the_end(finished_run):
    (curves,) = read_training([finished_run])
    assert curves["label"] == "fox · preset ours" and curves["seconds"] == 10.5 and curves["n"] == 110
    assert curves["psnr"] == [[5.0, 22.0], [10.5, 25.0]] and curves["flip"] == [[5.0, 0.2], [10.5, 0.1]]
    assert curves["l1"][0] == [1.0, 0.1] and len(curves["l1"]) == 10
    assert curves["final"]["ssim"] == 0.9


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
    assert len(figures(html)) == 8 and "60 primitives, SH degree 1; 32 x 24 pixels" in html
    assert sorted(p.name for p in out.iterdir()) == ["check.html", "check.json"]


def test_a_model_is_framed_when_no_camera_is_named(capsys, model, tmp_path, monkeypatch, few_points):
    monkeypatch.setattr("mi_dogsplat.check.run.synthetic_scenes", lambda width: [])
    flags = ["--only", "work-precision", "--width", 32, "--rounds", 1]
    assert run(capsys, model, "-o", tmp_path / "out", *flags)[0] == 0
    (scene,) = json.loads((tmp_path / "out" / "check.json").read_text())["work_precision"]
    whole = next(r for r in scene["rows"] if r["setting"] == "50 %")
    assert whole["mean_error"] > 1e-3  # it is in view


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
        ([tmp_path / "empty.ply", "-o", out], "empty.ply", "no primitives"),
        ([model, "-o", out, "--camera", "0"], "--data"),
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
