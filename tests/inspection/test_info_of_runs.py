"""``dogsplat info`` of run folders."""

import dataclasses
import json
from pathlib import Path

import tiny_data
from dataset_folders import transforms_folder
from described import value_of
from mi_dogsplat import write_ply
from mi_dogsplat.inspection.info import describe
from mi_dogsplat.runs.evaluation import evaluate_model
from mi_dogsplat.training.config import TrainConfig


def write_run(folder: Path) -> Path:
    quality = {"psnr": 27.345, "ssim": 0.9, "flip": 0.08, "l1": 0.02}
    metrics = {"test": quality, "train": {}, "n": 12345, "n_dog": 67, "bytes": 3_060_000, "train_seconds": 125.0}
    metrics |= {"steps": 700, "render_ms": 4.25}
    config = {"data": "photos/fox", "preset": "3dgs", "steps": 700, "downscale": 2, "max_primitives": None}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    (folder / "config.json").write_text(json.dumps(config))
    (folder / "history.jsonl").write_text('{"step": 350, "seconds": 60, "l1": 0.1, "n": 99, "n_dog": 0}\n')
    write_ply(folder / "point_cloud.ply", tiny_data.truth())
    return folder


def test_a_complete_run_shows_its_result(tmp_path):
    lines = describe(write_run(tmp_path))
    assert lines[0] == f"{tmp_path}: training run on photos/fox"
    assert value_of(lines, "steps") == "700 of 700"
    assert value_of(lines, "training time") == "2 min 05 s"
    assert value_of(lines, "primitives") == "12,345, 67 of them DoG"
    assert value_of(lines, "test") == "PSNR 27.34 dB, SSIM 0.9000, FLIP 0.0800, L1 0.02000"
    assert "downscale 2" in value_of(lines, "settings")
    assert lines[-1] == "problems: none found"


def test_what_a_run_or_a_data_set_holds_does_not_reach_a_terminal_as_it_is(tmp_path):
    run = write_run(tmp_path)
    config = json.loads((run / "config.json").read_text())
    (run / "config.json").write_text(json.dumps(config | {"data": "a\x1b[2Jb", "seed": "1\n  test   2"}))
    lines = describe(run)
    assert lines[0] == f"{run}: training run on a\\x1b[2Jb" and "seed 1\\n  test" in value_of(lines, "settings")
    file = transforms_folder(tmp_path / "data") / "transforms.json"
    content = json.loads(file.read_text())
    old = content["frames"][0]["file_path"]
    new = str(Path(old).with_name("\x1b]0;title\x07" + Path(old).name))
    (found,) = file.parent.glob(f"{old}*")
    found.rename(file.parent / new if found.suffix == Path(old).suffix else file.parent / (new + found.suffix))
    content["frames"][0]["file_path"] = new
    file.write_text(json.dumps(content))
    lines = describe(file.parent)
    assert "\\x1b]0;title\\x07" in value_of(lines, "names") and all(line.isprintable() for line in lines)


def test_a_run_that_has_another_recipe_than_that_of_its_preset_says_so(tmp_path):
    """A method of a comparison has the preset that is nearest to it in its settings."""
    run = write_run(tmp_path)
    (run / "recipe.json").write_text(json.dumps({"label": "Speedy-Splat", "recipe": {}}))
    assert value_of(describe(run), "settings") == 'recipe "Speedy-Splat", downscale 2, max_primitives None'


def test_views_that_are_no_test_views_are_not_called_so(tmp_path):
    run = write_run(tmp_path)
    config = json.loads((run / "config.json").read_text())
    (run / "config.json").write_text(json.dumps(config | {"split": "validation"}))
    lines = describe(run)
    assert value_of(lines, "validation").startswith("PSNR 27.34 dB")
    assert not [line for line in lines if line.startswith("  test ")]


def test_the_settings_of_a_run_that_were_given_are_shown(tmp_path):
    run = write_run(tmp_path)
    usual = dataclasses.asdict(TrainConfig("photos/fox"))
    given = {"target": "2MB", "format": "spz", "batch_views": 4, "appearance": True, "memory": "8G", "up": "z"}
    all_given = ", target 2MB, format spz, batch_views 4, appearance"
    clips = (({"near_clip": 0.2}, ""), ({"near_clip": 0.0500000012}, ", near_clip 0.05"))  # the usual one, and another
    for changed, shown in (({}, ""), (given, all_given), ({"target": 20000.0}, ", target 20000"), *clips):
        (run / "config.json").write_text(json.dumps(usual | changed))
        told = value_of(describe(run), "settings").split(", ")
        assert sorted(told) == sorted(f"preset ours, downscale 1, max_primitives None, seed 0{shown}".split(", "))


def test_a_run_that_gives_rows_to_primitives_tells_of_how_many(tmp_path):
    run = write_run(tmp_path)
    metrics = json.loads((run / "metrics.json").read_text())
    (run / "metrics.json").write_text(json.dumps(metrics | {"n_slopes": 1234}))
    assert value_of(describe(run), "primitives") == "12,345, 67 of them DoG, 1,234 with slopes"
    (run / "metrics.json").write_text(json.dumps(metrics | {"n_slopes": 1234, "n_cuts": 5}))
    assert value_of(describe(run), "primitives") == "12,345, 67 of them DoG, 1,234 with slopes, 5 with a cut"
    (run / "metrics.json").write_text(json.dumps(metrics | {"n_cuts": 5, "n_second_cuts": 4}))
    assert value_of(describe(run), "primitives") == "12,345, 67 of them DoG, 5 with a cut, 4 with a second cut"
    (run / "metrics.json").write_text(json.dumps(metrics | {"n_slopes": 6, "n_curvatures": 0, "n_cuts": 5}))
    assert value_of(describe(run), "primitives").endswith("DoG, 6 with slopes, 0 with curvatures, 5 with a cut")


def test_an_interrupted_run_shows_how_far_it_came(tmp_path):
    write_run(tmp_path)
    for name in ("metrics.json", "point_cloud.ply"):
        (tmp_path / name).unlink()
    with open(tmp_path / "history.jsonl", "a") as file:
        file.write('{"step": 40')
    lines = describe(tmp_path)
    assert value_of(lines, "steps") == "350 of 700" and value_of(lines, "primitives").startswith("99,")
    problems = lines[lines.index("problems:") + 1 :]
    assert problems == [
        "  metrics.json is missing",
        "  point_cloud.ply is missing",
        "  the run is not complete: it was interrupted, or is still running",
        "  history.jsonl has 1 line without valid JSON",
    ]


def test_what_eval_leaves_is_a_measurement_and_no_run(tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data", n=9)
    write_ply(tmp_path / "m.ply", tiny_data.truth())
    evaluate_model(tmp_path / "m.ply", data, tmp_path / "out")
    lines = describe(tmp_path / "out")
    assert lines[0] == f"{tmp_path / 'out'}: measurement of a model" and lines[-1] == "problems: none found"
    assert value_of(lines, "primitives") == str(tiny_data.N_TRUTH) and value_of(lines, "views") == "2: 0, 8"
    assert value_of(lines, "test").startswith("PSNR ")
    (tmp_path / "out" / "metrics.json").write_text("{}")  # of one that was killed
    assert "not complete" in describe(tmp_path / "out")[-1]
