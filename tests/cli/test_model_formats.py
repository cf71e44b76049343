"""Every command takes models of every format, and draws them as their files say."""

import itertools
import json
import shutil

import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat import Drawing, Model, read_model, to_ellipsoids, write_model
from mi_dogsplat.check import curves
from mi_dogsplat.check import run as check
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.render.framing import robust_sphere
from mi_dogsplat.render.viewpoint import viewpoint
from mi_dogsplat.viewer.source import Source
from PIL import Image

SMALL = ["--steps", "12", "--variant", "llvm_ad_rgb"]


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """The same model in every format, by the end of the name."""
    folder = tmp_path_factory.mktemp("models")
    model = Model(tiny_data.truth(), Drawing(antialiased=True, near_clip=0.05))
    for suffix in FORMATS:
        write_model(folder / f"model{suffix}", model)
    return {suffix: folder / f"model{suffix}" for suffix in FORMATS}


def pixels(path) -> np.ndarray:
    return np.asarray(Image.open(path)).astype(int)


@pytest.mark.parametrize("suffix", FORMATS)
def test_render_info_eval_export_and_view_take_it(capsys, models, data, tmp_path, suffix):
    model = models[suffix]
    status, printed, _ = run(capsys, "info", model)
    assert status == 0 and f"format          {FORMATS[suffix].name}" in printed and "60, 0 of them DoG" in printed
    assert ("antialiased" in printed) == (suffix != ".splat")
    assert run(capsys, "render", model, "-o", tmp_path / "a.png", "--data", data)[0] == 0
    assert run(capsys, "render", models[".ply"], "-o", tmp_path / "b.png", "--data", data)[0] == 0
    assert abs(pixels(tmp_path / "a.png") - pixels(tmp_path / "b.png")).mean() < (4 if suffix == ".splat" else 2)
    status, printed, _ = run(capsys, "eval", model, data)
    assert status == 0 and float(printed.split("PSNR")[-1].split()[0]) > 25
    for out in FORMATS:
        status, printed, _ = run(capsys, "export", model, "-o", tmp_path / f"out{out}", "--views", "0")
        assert status == 0 and read_model(tmp_path / f"out{out}").splats.n_splats == 60
    found = Source(model).poll()
    assert found and found[0].n_splats == 60
    assert to_ellipsoids(model)["centers"].shape == (60, 3)


@pytest.mark.slow
def test_check_and_prune_take_another_format(capsys, models, data, tmp_path, monkeypatch):
    for knob in ("ALPHA", "TRANSMITTANCE", "BOUND", "PATCH", "KEPT"):  # each setting is kernels
        monkeypatch.setattr(curves, knob, dict([*getattr(curves, knob).items()][:1]))
    monkeypatch.setattr(check, "synthetic_scenes", lambda width: [])  # the model alone
    flags = ["--only", "work-precision", "--width", "16", "--rounds", "1"]
    status, *_ = run(capsys, "check", models[".spz"], "-o", tmp_path / "check", *flags)
    assert status == 0 and json.loads((tmp_path / "check" / "check.json").read_text())["model_name"] == "model.spz"
    status, *_ = run(capsys, "prune", models[".spz"], data, "-o", tmp_path / "run", "--target", "15", *SMALL)
    assert status == 0
    config = json.loads((tmp_path / "run" / "config.json").read_text())
    assert config["antialiased"] is True and config["near_clip"] == 0.2  # SPZ has room for the one only
    assert read_model(tmp_path / "run" / "point_cloud.ply").drawing == Drawing(True, 0.2, False, up="z")


def test_what_the_file_says_needs_no_flag_and_a_flag_comes_first(capsys, models, data, tmp_path):
    silent = tmp_path / "silent.ply"
    write_model(silent, tiny_data.truth())
    pictures = {}
    for name, (model, flags) in {
        "file": (models[".ply"], []), "flags": (silent, ["--antialiased", "--near-clip", "0.05"]),
        "against": (models[".ply"], ["--no-antialiased", "--near-clip", "0.2"]), "usual": (silent, []),
    }.items():  # fmt: skip
        assert run(capsys, "render", model, "-o", tmp_path / f"{name}.npz", "--data", data, *flags)[0] == 0
        pictures[name] = np.load(tmp_path / f"{name}.npz")["color"]
    assert np.array_equal(pictures["file"], pictures["flags"])
    assert np.array_equal(pictures["against"], pictures["usual"])
    assert not np.array_equal(pictures["file"], pictures["usual"])


def test_a_training_writes_how_its_model_is_drawn_and_eval_needs_no_flag(capsys, data, tmp_path):
    flags = ["--preset", "3dgs", *SMALL, "--antialiased", "--near-clip", "0.1"]
    assert run(capsys, "train", data, "-o", tmp_path / "run", *flags)[0] == 0
    model = tmp_path / "run" / "point_cloud.ply"
    assert read_model(model).drawing == Drawing(antialiased=True, near_clip=0.1, linear=False, up="z")
    assert b"\ncomment SplatRenderMode: mip\n" in model.read_bytes()
    assert run(capsys, "eval", model, data, "-o", tmp_path / "measured")[0] == 0
    measured = json.loads((tmp_path / "measured" / "metrics.json").read_text())["test"]
    assert measured == pytest.approx(json.loads((tmp_path / "run" / "metrics.json").read_text())["test"], rel=1e-4)


def test_linear_colours_are_shown_as_srgb_and_arrays_hold_them(capsys, data, tmp_path):
    write_model(tmp_path / "a.ply", tiny_data.truth())
    write_model(tmp_path / "b.ply", Model(tiny_data.truth(), Drawing(linear=True)))
    for name, suffix in itertools.product("ab", ("png", "npz")):
        out = tmp_path / f"{name}.{suffix}"
        assert run(capsys, "render", tmp_path / f"{name}.ply", "-o", out, "--data", data)[0] == 0
    plain, radiance = (np.load(tmp_path / f"{name}.npz")["color"] for name in "ab")
    np.testing.assert_allclose(np.clip(radiance, 0, 1), plain, atol=1e-6)
    shown = np.asarray(Image.open(tmp_path / "b.png").convert("RGB")) / 255
    expected = np.where(plain <= 0.0031308, 12.92 * plain, 1.055 * np.maximum(plain, 1e-9) ** (1 / 2.4) - 0.055)
    assert np.abs(shown - expected).max() < 0.51 / 255 and np.abs(shown - plain).max() > 0.1


def test_a_view_that_nobody_names_stands_upright_as_the_file_says(tmp_path):
    for up, vector in (("z", (0, 0, 1)), ("-y", (0, -1, 0)), ("x", (1, 0, 0))):
        write_model(tmp_path / "a.ply", Model(tiny_data.truth(), Drawing(up=up)))
        read = read_model(tmp_path / "a.ply")
        camera = viewpoint(read.splats, drawing=read.drawing).camera
        pixels, depth = camera.project(robust_sphere(read.splats)[0] + 0.1 * np.array([vector, np.zeros(3)]))
        assert depth.min() > 0 and abs(pixels[0, 0] - pixels[1, 0]) < 0.01 and pixels[0, 1] < pixels[1, 1] - 10


def test_export_says_in_a_line_what_the_format_cannot_carry(capsys, models, tmp_path):
    _, printed, _ = run(capsys, "export", models[".ply"], "-o", tmp_path / "a.spz", "--views", "0")
    assert printed.splitlines()[0] == "SPZ cannot say how it is drawn: near_clip 0.05; give it by hand"
    _, printed, _ = run(capsys, "export", models[".ply"], "-o", tmp_path / "a.sog", "--views", "0")
    assert len(printed.splitlines()) == 1
    assert run(capsys, "export", models[".ply"], "-o", tmp_path / "b.spz", "--views", "0", "--spz-version", "4")[0] == 0
    assert (tmp_path / "b.spz").read_bytes()[:8] == b"NGSP\4\0\0\0"
    wrong = run(capsys, "export", models[".ply"], "-o", tmp_path / "c.spz", "--views", "0", "--spz-version", "1")
    assert_one_line(wrong, "SPZ 1", "3 or 4")


def test_export_keeps_dog_only_where_there_is_room(capsys, tmp_path):
    write_model(tmp_path / "a.ply", tiny_data.dog_model())
    export = ["export", tmp_path / "a.ply", "--views", "0", "--dog", "keep", "-o"]
    assert run(capsys, *export, tmp_path / "b.ply")[0] == 0
    assert read_model(tmp_path / "b.ply").splats.n_dog == tiny_data.dog_model().n_dog
    assert_one_line(run(capsys, *export, tmp_path / "b.spz"), "--dog", "SPZ cannot hold DoG")


def test_prune_looks_at_its_model_before_the_data(capsys, data, tmp_path):
    write_model(tmp_path / "a.ply", tiny_data.truth())
    empty = tmp_path / "data"
    shutil.copytree(data, empty)
    (empty / "transforms.json").write_text("broken")
    prune = ["prune", tmp_path / "no.spz", empty, "-o", tmp_path / "run", *SMALL]
    assert_one_line(run(capsys, *prune), "no.spz")
    prune[1] = tmp_path / "a.ply"
    assert_one_line(run(capsys, *prune, "--target", "99"), "--target", "a.ply")
    assert_one_line(run(capsys, *prune), "transforms.json")
    write_model(tmp_path / "a.ply", Model(tiny_data.truth(), Drawing(linear=True)))
    prune[2] = data  # which decides whether a model that is linear fits
    assert_one_line(run(capsys, *prune), "a.ply", "linear")
