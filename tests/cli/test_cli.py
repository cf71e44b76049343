"""The command line: its commands work, its help teaches, and bad input is one line and exit status 2."""

import json
import shutil
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from dataset_folders import transforms_folder
from happenings import history_of, records
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.cli.parser import build_parser
from mi_dogsplat.cli.printing import metrics_line
from mi_dogsplat.runs.checkpoint import save_checkpoint
from mi_dogsplat.scene.camera_file import write_camera
from mi_dogsplat.support.pictures import write_png
from mi_dogsplat.support.wording import file_size
from PIL import Image

COMMANDS = ("train", "prune", "ablate", "compare", "render", "eval", "capture", "info", "check", "export", "view")
COMMANDS += ("clean", "film", "masks", "mesh", "poses", "serve", "simplify")
SMALL = ["--preset", "3dgs", "--steps", "12", "--sh-degree", "1", "--max-primitives", "80", "--variant", "llvm_ad_rgb"]


# --- the commands ---


def test_negative_numbers_of_any_notation_are_no_flags():
    words = ["-1", "-0.5", "-.5", "-5.", "-5e-1", "-2.5E+3"]
    flags = ["--box", *words, "--sphere", "0", "0", "-1e3", "2"]
    args = build_parser().parse_args(["clean", "a.ply", "-o", "b.ply", *flags])
    assert args.box == [-1, -0.5, -0.5, -5, -0.5, -2500] and args.sphere == [0, 0, -1000, 2]
    assert build_parser().parse_args(["film", "a.ply", "-o", "b", "--elevation", "-1e1"]).elevation == -10


@pytest.mark.parametrize("words", [["ablate", "a", "b", "-o", "c"], ["info", "a", "--frobnicate"]])
def test_what_a_command_does_not_know_is_answered_with_its_own_help(words, capsys):
    with pytest.raises(SystemExit, match="2"):
        build_parser().parse_args(words)
    unknown = words[2]
    assert capsys.readouterr().err == f"dogsplat: unrecognized arguments: {unknown}; see dogsplat {words[0]} --help\n"


@pytest.mark.parametrize("words", [["train", "--data", "x", "-o", "c"], ["eval", "a.ply", "--data=x"]])
def test_data_as_a_flag_is_no_short_form_of_data_on_disk(words, capsys):
    with pytest.raises(SystemExit, match="2"):
        build_parser().parse_args(words)
    problem = "argument --data: DATA stands without a flag here, as in the first example"
    assert capsys.readouterr().err == f"dogsplat: {problem}; see dogsplat {words[0]} --help\n"


def test_train_then_info_render_and_eval_on_what_it_made(capsys, data, tmp_path):
    out = tmp_path / "run"
    status, printed, bar = run(capsys, "train", data, "-o", out, *SMALL)
    assert status == 0 and "PSNR" in printed and "report.html" in printed and "12/12" in bar
    n = read_ply(out / "point_cloud.ply").n_splats
    size = file_size((out / "point_cloud.ply").stat().st_size)
    assert f"\n{n} primitives, {size}, " in printed and "kB" in size
    status, printed, _ = run(capsys, "info", out)
    assert status == 0 and "12 of 12" in printed and "problems: none" in printed

    status, printed, _ = run(capsys, "info", out / "point_cloud.ply")
    assert status == 0 and f"{n}, 0 of them DoG" in printed

    status, printed, _ = run(capsys, "render", out / "point_cloud.ply", "-o", tmp_path / "v.png", "--data", data)
    assert status == 0 and printed.strip() == str(tmp_path / "v.png")
    rendered, tested = (np.asarray(Image.open(p)) for p in (tmp_path / "v.png", out / "test" / "0.png"))
    assert abs(rendered.astype(int) - tested).max() <= 1

    status, printed, _ = run(capsys, "eval", out / "point_cloud.ply", data, "-o", tmp_path / "measured")
    assert status == 0 and printed.splitlines()[-1].startswith("mean")
    measured = json.loads((tmp_path / "measured" / "metrics.json").read_text())["test"]
    assert measured == pytest.approx(json.loads((out / "metrics.json").read_text())["test"], rel=1e-4)
    assert (tmp_path / "measured" / "0_error.png").is_file()


def test_names_of_images_do_not_reach_the_terminal_as_they_are(capsys, data, tmp_path):
    photos = shutil.copytree(data, tmp_path / "photos")
    content = json.loads((photos / "transforms.json").read_text())
    for frame in content["frames"]:
        new = frame["file_path"].replace("images/", "images/\x1b[31m")
        (photos / frame["file_path"]).rename(photos / new)
        frame["file_path"] = new
    (photos / "transforms.json").write_text(json.dumps(content))
    write_ply(tmp_path / "m.ply", tiny_data.truth())
    status, printed, _ = run(capsys, "eval", tmp_path / "m.ply", photos)
    assert status == 0 and printed.startswith("\\x1b[31m0 ") and "\x1b" not in printed


def test_train_says_which_views_it_measured(capsys, data, tmp_path):
    command = ["train", data, "-o", tmp_path / "run", *SMALL[:3], "2", *SMALL[4:], "--split", "validation"]
    status, printed, _ = run(capsys, *command)
    assert status == 0 and "measuring 1 validation view and" in printed and "\nvalidation views: PSNR" in printed
    assert "test view" not in printed


def test_views_that_a_model_has_learned_from_are_told_where_they_are_measured(capsys, data, tmp_path, monkeypatch):
    """By ``prune``, which measures validation views of a run that did not hold them out, and by ``eval`` of data whose
    split has moved since, be it with the poses that the run has refined."""
    model = tmp_path / "run" / "point_cloud.ply"
    model.parent.mkdir()
    write_ply(model, tiny_data.truth())
    (model.parent / "config.json").write_text(json.dumps({"data": str(data)}))
    said = f"{model} was trained on 1 of the 1 measured views"
    for learned, told in (("1", False), ("0", True)):
        save_checkpoint(model.parent / "checkpoint" / "state.npz", {"views": np.array([learned, "2"])})
        for of_run in (data, shutil.copytree(data, model.parent / "refined", dirs_exist_ok=True)):
            assert (said in run(capsys, "eval", model, of_run)[1]) is told
    save_checkpoint(model.parent / "checkpoint" / "state.npz", {"views": np.array(["1"])})
    metrics = {"test": {}, "train": {"psnr": 20.0}, "views": {"1": {}}, "n": 9, "bytes": 9, "train_seconds": 1.0}
    monkeypatch.setattr("mi_dogsplat.runs.run.train", lambda *_: metrics)
    assert said in run(capsys, "prune", model, data, "-o", tmp_path / "small", "--split", "validation")[1]


def test_train_says_which_masks_are_not_followed_and_which_images_have_none(capsys, tmp_path):
    file = transforms_folder(tmp_path / "data") / "transforms.json"
    content = json.loads(file.read_text())
    content["frames"][1]["mask_path"] = "masks/r_1.png"
    file.write_text(json.dumps(content))
    write_png(tmp_path / "data" / "masks" / "r_1.png", np.ones((15, 21), np.float32))
    command = ["train", file.parent, "-o", tmp_path / "run", "--preset", "3dgs", "--steps", "2", *SMALL[4:]]
    command += ["--initial-primitives", "50"]
    said = f'{file.parent}: not read: the "mask_path" of 1 of its frames; --masks {file.parent / "masks"} uses them'
    status, printed, _ = run(capsys, *command)
    assert status == 0 and said in printed
    masks, n = file.parent / "masks", len(content["frames"])
    status, printed, _ = run(capsys, *command, "--masks", masks)
    assert status == 0 and "not read" not in printed
    assert f"{masks}: no mask for {n - 1} of {n} images, such as r_0; all of their pixels count\n" in printed
    for k in range(n):
        write_png(masks / f"r_{k}.png", np.ones((15, 21), np.float32))
    assert "no mask" not in run(capsys, *command, "--masks", masks)[1]


def test_compare_says_what_of_its_data_is_not_read(capsys, tmp_path, monkeypatch):
    file = transforms_folder(tmp_path / "data") / "transforms.json"
    (file.parent / "images" / "dynamic_mask_r_1.png").touch()
    monkeypatch.setattr("mi_dogsplat.compare.compare.compare", lambda *_, **__: {"failed": {}})
    printed = run(capsys, "compare", file.parent, "-o", tmp_path / "compared")[1]
    assert printed.startswith(f"{file.parent}: not read: the dynamic_mask_*.png of 1 of its images")


def test_prune_makes_a_smaller_model_and_a_whole_run_folder(capsys, model, data, tmp_path):
    out = tmp_path / "run"
    status, printed, bar = run(
        capsys, "prune", model, data, "-o", out, "--target", "15", "--steps", "12", "--variant", "llvm_ad_rgb"
    )
    assert status == 0 and "PSNR" in printed and "report.html" in printed and "12/12" in bar
    splats = read_ply(out / "point_cloud.ply")
    assert splats.n_splats <= 15 and splats.n_dog > 0 and splats.sh_degree == 1
    history = history_of(out)
    assert records(history, "pruned")[0]["before"] == 60 and history[-1]["n"] == 15
    assert (out / "report.html").is_file() and (out / "test" / "0.png").is_file()


@pytest.mark.parametrize("preset", ["ours", "paper", "released"])
def test_train_with_a_preset_of_the_method_gives_a_model_with_dog(capsys, data, tmp_path, preset):
    flags = ["--preset", preset, "--target", "0.5", *SMALL[2:]]
    assert run(capsys, "train", data, "-o", tmp_path / "run", *flags)[0] == 0
    assert read_ply(tmp_path / "run" / "point_cloud.ply").n_dog > 0
    assert json.loads((tmp_path / "run" / "config.json").read_text())["preset"] == preset


def test_eval_of_the_true_model_is_near_perfect_and_without_o_writes_nothing(capsys, model, data):
    before = sorted(data.rglob("*"))
    status, printed, _ = run(capsys, "eval", model, data)
    name, _, psnr, *_ = printed.splitlines()[0].split()
    assert status == 0 and name == "0" and float(psnr) > 50  # 8-bit images
    assert sorted(data.rglob("*")) == before


def test_eval_with_masks_that_leave_nothing_to_measure_is_one_line(capsys, model, data, tmp_path):
    write_png(tmp_path / "0.png", np.zeros((tiny_data.HEIGHT, tiny_data.WIDTH), np.float32))  # the only test view
    command = ["eval", model, data, "--masks", tmp_path, "-o", tmp_path / "out"]
    assert_one_line(run(capsys, *command), str(tmp_path), "is black in every view")
    assert not (tmp_path / "out").exists()


def test_eval_says_which_images_have_no_mask(capsys, model, data, tmp_path):
    write_png(tmp_path / "1.png", np.ones((tiny_data.HEIGHT, tiny_data.WIDTH), np.float32))  # of a training view
    said = f"{tmp_path}: no mask for 1 of 1 images, such as 0; all of their pixels count\n"
    assert said in run(capsys, "eval", model, data, "--masks", tmp_path)[1]


def test_eval_can_write_into_its_own_earlier_folder(capsys, model, data, tmp_path):
    for _ in range(2):
        assert run(capsys, "eval", model, data, "-o", tmp_path / "out")[0] == 0


def test_eval_does_not_replace_the_metrics_of_a_training_run(capsys, model, data, tmp_path):
    (tmp_path / "config.json").write_text("{}")
    assert_one_line(run(capsys, "eval", model, data, "-o", tmp_path), "training run", "another folder")


def test_the_background_follows_the_data(capsys, model, tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data", n=2, alpha=True)
    for background, good in (("auto", True), ("white", True), ("black", False)):
        _, printed, _ = run(capsys, "eval", model, data, "--background", background)
        assert "PSNR" in printed
        assert (float(printed.split("PSNR")[1].split()[0]) > 40) or not good


def test_a_camera_file_and_a_scene_are_rendered(capsys, model, tmp_path):
    write_camera(tmp_path / "c.json", tiny_data.cameras()[0])
    out = tmp_path / "v.exr"
    assert run(capsys, "render", model, "-o", out, "--camera", tmp_path / "c.json")[0] == 0
    (tmp_path / "s.xml").write_text(
        f'<scene version="3.0.0"><integrator type="dogsplat"/><shape type="dog"><string name="filename" '
        f'value="{model}"/></shape><sensor type="perspective"><film type="hdrfilm">'
        '<integer name="width" value="16"/><integer name="height" value="12"/></film></sensor></scene>'
    )
    assert run(capsys, "render", tmp_path / "s.xml", "-o", tmp_path / "s.png")[0] == 0
    assert np.asarray(Image.open(tmp_path / "s.png")).shape == (12, 16, 3)


def test_the_line_of_metrics_has_what_each_kind_of_run_is_judged_by():
    line = metrics_line({"psnr": 20.0, "cc_psnr": 21.0, "half_psnr": 22.0, "aligned_psnr": 23.0, "psnr_mu": 24.0})
    for value in range(20, 25):
        assert f"{value}.00 dB" in line


# --- help ---


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_a_command_shows_examples_that_parse(capsys, command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    status, text, _ = run(capsys, command, "--help")
    assert status == 0 and "Examples:" in text and "None" not in text
    lines = [line.strip() for line in text.splitlines() if line.startswith("  dogsplat ")]
    assert len(lines) >= 2
    for line in lines:
        example = line.split("  ")[0].split()  # what follows two spaces is a remark
        assert build_parser().parse_args(example[1:]).command == command
    for line in text.splitlines():
        assert len(line) <= 110


def test_only_what_takes_a_run_folder_speaks_of_its_settings(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "300")
    texts = {command: run(capsys, command, "--help")[1] for command in COMMANDS}
    told = {command for command, text in texts.items() if "for a run folder: as in its training" in text}
    assert told == {"film", "view"}
    assert "auto, which is grey" in texts["simplify"] and "images with alpha" not in texts["simplify"]


def test_the_help_of_the_program_names_every_command_a_first_run_and_exit_codes(capsys):
    status, text, _ = run(capsys, "--help")
    assert status == 0
    for word in (*COMMANDS, "A first run:", "Exit codes", "transforms.json", "COLMAP"):
        assert word in text


def test_the_version_names_what_results_depend_on(capsys):
    status, text, _ = run(capsys, "--version")
    assert status == 0 and text.count("\n") == 1
    assert text.startswith("dogsplat ") and all(f", {name} {version(name)}" in text for name in ("mitsuba", "drjit"))


def test_argparse_stops_at_the_command_line():
    package = Path(__file__).parents[2] / "mi_dogsplat"
    found = {path.relative_to(package) for path in package.rglob("*.py") if "argparse" in path.read_text("utf-8")}
    shared = {Path("cli/parser.py"), Path("cli/flags.py"), Path("cli/scene_flags.py"), Path("demo/__main__.py")}
    assert found == shared | {Path(f"cli/commands/{name}.py") for name in ("__init__", *COMMANDS)}


# --- wrong use ---


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--steps", "0"], ["--steps", "0", "at least 1"]),
        (["--steps", "-5"], ["--steps", "-5", "at least 1"]),
        (["--steps", "many"], ["--steps", "many"]),
        (["--downscale", "0"], ["--downscale", "at least 1"]),
        (["--downscale", "500"], ["48x36", "cannot be downscaled by 500"]),
        (["--max-primitives", "-1"], ["--max-primitives", "-1", "at least 1"]),
        (["--max-primitives", "0"], ["--max-primitives", "at least 1"]),
        (["--sh-degree", "7"], ["--sh-degree", "7", "0 to 3"]),
        (["--near-clip", "nan"], ["--near-clip", "nan"]),
        (["--near-clip", "-1"], ["--near-clip", "-1"]),
        (["--seed", "-1"], ["--seed", "at least 0"]),
        (["--log-every", "0"], ["--log-every", "at least 1"]),
        (["--test-every", "-1"], ["--test-every", "at least 0"]),
        (["--initial-primitives", "0"], ["--initial-primitives", "at least 1"]),
        (["--preset", "best"], ["--preset", "best", "ours_early or paper or released or 3dgs"]),
        (["--format", "obj"], ["--format", "obj", "ply or spz or sog"]),
        (["--target", "0"], ["--target", "ratio", "whole number"]),
        (["--target", "2.5"], ["--target", "2.5"]),
        (["--target", "100%"], ["--target", "100%", "a ratio below 1 (0.1, 10%)"]),
        (["--target", "0MB"], ["--target", "0MB", "the size of the file (2MB)"]),
        (["--target", "2MX"], ["--target", "2MX", "the size of the file (2MB)"]),
        (["--target", "2MB", "--preset", "3dgs"], ["--target", "2MB", "3dgs", "use ours or ours_slopes or"]),
        (["--target", "100", "--preset", "3dgs"], ["--target: 100 needs pruning", "use ours or ours_slopes or"]),
        (["--target", "300", "--max-primitives", "300"], ["--target", "300", "--max-primitives"]),
        (["--background", "green"], ["--background", "green", "black or white or auto"]),
        (["--variant", "scalar_rgb"], ["--variant", "scalar_rgb", "llvm_ad_rgb"]),
        (["--variant", "vulkan"], ["--variant", "vulkan"]),
        (["--colour", "red"], ["--colour", "--help"]),
    ],
    ids=lambda value: " ".join(value) if value[0].startswith("--") else "",
)
def test_a_wrong_value_of_train_is_one_line_and_leaves_no_folder(capsys, data, tmp_path, flags, words):
    assert_one_line(run(capsys, "train", data, "-o", tmp_path / "run", *flags), *words)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("command", ["render", "eval"])
@pytest.mark.parametrize("flags", [["--downscale", "0"], ["--background", "green"], ["--near-clip", "inf"]])
def test_a_wrong_value_of_render_and_eval_is_one_line(capsys, model, data, tmp_path, command, flags):
    rest = ["-o", tmp_path / "v.png"] if command == "render" else [data]
    assert_one_line(run(capsys, command, model, *rest, *flags), flags[0])


@pytest.mark.parametrize(
    "argv",
    [
        [],
        ["paint"],
        ["train"],
        ["train", "x"],
        ["prune", "m.ply", "x"],
        ["render", "m.ply"],
        ["eval", "m.ply"],
        ["info"],
        ["info", "a", "b"],
    ],
)
def test_an_incomplete_or_unknown_command_is_one_line_that_points_to_the_help(capsys, argv):
    assert_one_line(run(capsys, *argv), "--help")


def test_bad_files_are_one_line_that_names_them(capsys, model, data, tmp_path):
    (tmp_path / "bad.ply").write_text("ply\nnonsense\n")
    (tmp_path / "bad.json").write_text("{")
    (tmp_path / "bad.xml").write_text("<scene")
    (tmp_path / "empty").mkdir()
    out = tmp_path / "v.png"
    for argv, word in [
        (["train", tmp_path / "missing", "-o", tmp_path / "run"], "missing"),
        (["train", tmp_path / "empty", "-o", tmp_path / "run"], "not a known data set"),
        (["train", tmp_path / "bad.xml", "-o", tmp_path / "run"], "bad.xml"),
        (["train", data, "-o", data], "other contents"),
        (["train", data, "-o", model], "is a file"),
        (["train", data, "-o", model / "run"], "model.ply"),
        (["render", tmp_path / "missing.ply", "-o", out], "missing.ply"),
        (["render", tmp_path / "missing.xml", "-o", out], "missing.xml"),
        (["render", tmp_path / "bad.ply", "-o", out], "bad.ply"),
        (["render", tmp_path / "bad.xml", "-o", out], "bad.xml"),
        (["render", tmp_path / "empty", "-o", out], "folder"),
        (["render", model, "-o", tmp_path / "v.gif"], ".png, .exr, .npz"),
        (["render", model, "-o", out, "--camera", tmp_path / "bad.json"], "bad.json"),
        (["render", model, "-o", tmp_path / "v.exr", "--aovs", "albedo"], "albedo"),
        (["render", tmp_path / "bad.xml", "-o", tmp_path / "v.exr", "--aovs", "depth"], 'the property "aovs"'),
        (["render", tmp_path / "bad.xml", "-o", out, "--data", data], "--data: is only for models"),
        (["render", tmp_path / "bad.xml", "-o", out, "--near-clip", "1"], "--near-clip: is only for models"),
        (["render", model, "-o", out, "--camera", "0"], "--data"),
        (["render", model, "-o", out, "--data", data, "--camera", "zebra"], "zebra"),
        (["prune", tmp_path / "missing.ply", data, "-o", tmp_path / "run"], "missing.ply"),
        (["prune", tmp_path / "bad.ply", data, "-o", tmp_path / "run"], "bad.ply"),
        (["prune", model, tmp_path / "empty", "-o", tmp_path / "run"], "empty"),
        (["prune", model, data, "-o", tmp_path / "run", "--target", "60"], "60"),
        (["prune", model, data, "-o", tmp_path / "run", "--preset", "3dgs"], "does not prune"),
        (["prune", model, data, "-o", data], "other contents"),
        (["prune", model, data, "-o", tmp_path / "run", "--white", "3"], "--white: is for linear images"),
        (["compare", tmp_path / "missing", "-o", tmp_path / "run"], "missing"),
        (["compare", data, data, "-o", tmp_path / "run"], "two data sets"),
        (["compare", data, "-o", data], "other contents"),
        (["compare", data, "-o", model], "is a file"),
        (["compare", data, "-o", tmp_path / "run", "--only", "magic"], "magic"),
        (["compare", data, "-o", tmp_path / "run", "--workers", "-1"], "--workers"),
        (["compare", data, "-o", tmp_path / "run", "--seeds", "0", "-1"], "--seeds: -1 is out of range"),
        (["ablate", data, "-o", tmp_path / "run", "--seeds", "-1"], "--seeds: -1 is out of range"),
        (["compare", data, "-o", tmp_path / "run", "--cluster", "nowhere"], "nowhere"),
        (["compare", data, "-o", tmp_path / "run", "--cluster", "nowhere", "--workers", "2"], "--workers: is for"),
        (["eval", tmp_path / "bad.ply", data], "bad.ply"),
        (["eval", model, tmp_path / "empty"], "empty"),
        (["eval", model, data, "-o", data], "other contents"),
        (["info", tmp_path / "missing"], "missing"),
        (["info", tmp_path / "empty"], "data set"),
        (["info", tmp_path / "bad.ply"], "bad.ply"),
        (["info", tmp_path / "bad.xml"], "bad.xml"),
    ]:
        assert_one_line(run(capsys, *argv), word)
    assert not out.exists() and not (tmp_path / "run").exists()
