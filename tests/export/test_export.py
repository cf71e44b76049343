"""``dogsplat export``: DoG as plain Gaussians, the table of what is lost, and bad input."""

import json
import sys

import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.export.bake import RATIOS, baked, nearest_gaussians
from mi_dogsplat.export.export_config import ExportConfig
from mi_dogsplat.export.losses import Loss, Views, losses, mean_psnr, views_of
from mi_dogsplat.export.write import export_model
from mi_dogsplat.formats import gltf_read, spz
from mi_dogsplat.formats.packing import LUF, turned
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.render.framing import cameras_around, robust_sphere
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.scene.drawing import DrawnAs, drawn_as
from mi_dogsplat.scene.splats import Splats
from scipy.integrate import dblquad
from scipy.optimize import minimize


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "model.ply"
    write_ply(path, tiny_data.dog_model())
    return path


@pytest.mark.parametrize("f_a, F", [(0.3, 1.4), (0.5, 0.6), (0.2, 0.3)])
def test_a_baked_gaussian_is_the_nearest_in_the_picture_of_a_round_dog(f_a, F):
    """Oracle: the squared difference integrated over the plane, minimised over scale and peak."""

    def distance(x):
        scale, peak = x
        profile = lambda r: peak * np.exp(-r * r / 2 / scale**2) - np.exp(-r * r / 2) + f_a * np.exp(-r * r / 2 / F**2)  # noqa: E731
        return dblquad(lambda r, _: r * profile(r) ** 2, 0, 1, 0, 12, epsabs=1e-6)[0]

    best = minimize(distance, [1.0, 1 - f_a], method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-7}).x
    ratios, factors = nearest_gaussians(np.array([f_a], np.float32), np.full((1, 3), F, np.float32), np.ones((1, 3)))
    assert ratios[0] == pytest.approx([best[0]] * 3, rel=2 * (RATIOS[1] / RATIOS[0] - 1))
    assert factors[0] == pytest.approx(best[1], rel=0.02)


@pytest.mark.parametrize("f_a, F, scales", [(0.4, [0.5, 1.3, 0.8], [1, 0.5, 0.2]), (0.6, [0.4, 0.4, 2], [2, 2, 0.1])])
def test_a_baked_gaussian_is_the_nearest_in_views_along_the_axes_by_their_areas(f_a, F, scales):
    """Oracle: squared differences in the three views, summed over a grid, minimised over three scales and the peak."""
    line = np.linspace(-12, 12, 241)

    def distance(x):
        total = 0.0
        for j, k in ((0, 1), (0, 2), (1, 2)):
            square = lambda r, j=j, k=k: (line[:, None] / r[j]) ** 2 + (line / r[k]) ** 2  # noqa: E731
            dog = np.exp(-square(np.ones(3)) / 2) - f_a * np.exp(-square(F) / 2)
            total += scales[j] * scales[k] * np.square(x[3] * np.exp(-square(x) / 2) - dog).sum()
        return total

    options = {"xatol": 1e-4, "fatol": 1e-9, "maxiter": 4000, "maxfev": 4000}
    best = minimize(distance, [1.0, 1, 1, 1 - f_a], method="Nelder-Mead", options=options).x
    ratios, factors = nearest_gaussians(*(np.array([x], np.float32) for x in (f_a, F, scales)))
    assert ratios[0] == pytest.approx(best[:3], rel=2 * (RATIOS[1] / RATIOS[0] - 1))
    assert factors[0] == pytest.approx(best[3], rel=0.02)
    assert distance([*ratios[0], factors[0]]) < 1.005 * distance(best)


def test_a_weak_dog_stays_as_it_is_and_plain_gaussians_are_untouched():
    ratios, factors = nearest_gaussians(
        np.array([1e-6], np.float32), np.array([[0.5, 1.5, 2]], np.float32), np.ones((1, 3))
    )
    assert ratios[0] == pytest.approx([1, 1, 1], rel=0.01) and factors[0] == pytest.approx(1, rel=0.02)
    model = tiny_data.dog_model()
    plain = baked(model)
    assert plain.n_dog == 0 and plain.n_splats == model.n_splats
    assert np.array_equal(plain.log_scales[1::2], model.log_scales[1::2])
    assert np.array_equal(plain.logit_opacities[1::2], model.logit_opacities[1::2])
    assert (plain.opacities[::2] < model.opacities[::2]).all()


@pytest.mark.parametrize("f_a, F", [(0.3, 1.4), (0.4, 0.6)])
def test_baking_keeps_more_of_the_picture_than_dropping_or_lowering_the_peak(f_a, F):
    model = tiny_data.dog_model(f_a, F)
    views = Views(tiny_data.cameras(), [], 0.0, DrawnAs())
    truth = views.pictures(model)
    lower = model.plain()
    p = model.opacities[model.dog_index] * (1 - model.dog_opacities)
    lower.logit_opacities[model.dog_index] = np.log(p / (1 - p))
    loss = {name: mean_psnr(views.pictures(m), truth) for name, m in
            {"baked": baked(model), "dropped": model.plain(), "lower": lower}.items()}  # fmt: skip
    assert loss["baked"] > max(loss["dropped"], loss["lower"]) + 1


@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_is_written_measured_and_close_to_the_baked_model(capsys, model, tmp_path, suffix):
    out = tmp_path / f"out{suffix}"
    status, printed, _ = run(capsys, "export", model, "-o", out, "--views", "2", "--near-clip", "0.05", "--refine", "0")
    said = {".spz": ["near_clip 0.05"], ".splat": ["near_clip 0.05", "SH degree 0"]}.get(suffix, [])
    lines = printed.splitlines()
    assert all(words in line for words, line in zip(said, lines, strict=False)), printed
    lines = lines[len(said) :]
    assert status == 0 and "of the model" in lines[0] and "photographs" not in lines[0], printed
    assert [line.split("  ")[1] for line in lines[1:4]] == ["as it is", "without DoG (bake)", "read from the file"]
    without, read = (float(line.split()[-2]) for line in lines[2:4])
    assert 15 < without < 60 and read > without - 3
    assert "60 primitives" in lines[-1] and str(out) in lines[-1]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(["model.ply", out.name])


def test_the_figures_of_all_stages_stand_below_each_other(capsys, model, tmp_path):
    small = run(capsys, "export", model, "-o", tmp_path / "a.spz", "--small", "--refine", 0, "--views", 1)[1]
    ends = [line.index(" dB") for line in small.splitlines() if " dB" in line]
    assert len(ends) == 3 and len({*ends}) == 1, small


def test_spz_gltf_and_openusd_have_y_up_and_the_others_the_axes_of_the_model(capsys, model, tmp_path):
    for suffix in FORMATS:
        assert run(capsys, "export", model, "-o", tmp_path / f"out{suffix}", "--views", "0", "--refine", "0")[0] == 0
    truth = baked(read_ply(model))
    middle = truth.means.mean(axis=0)
    for suffix, chosen in FORMATS.items():
        sign = {"SPZ": [1, -1, -1], "OpenUSD": [1, -1, -1], "glTF": [-1, -1, 1]}.get(chosen.name, [1, 1, 1])
        found = chosen.read(tmp_path / f"out{suffix}").splats
        assert found.means.mean(axis=0) == pytest.approx(middle * sign, abs=2e-3)
    bundle = gltf_read.read(tmp_path / "out.glb").splats
    for name in ("means", "log_scales", "sh_coeffs"):  # those of baking, not of the primaries alone
        assert getattr(bundle, name) == pytest.approx(getattr(turned(truth, LUF), name), abs=1e-5), name
    assert spz.read(tmp_path / "out.spz").splats.n_splats == truth.n_splats


def test_with_data_the_loss_is_against_its_photographs_too(capsys, model, data, tmp_path):
    command = ["export", model, "-o", tmp_path / "out.ply", "--data", data, "--dog", "drop"]
    status, printed, _ = run(capsys, *command)
    assert status == 0 and "of photographs" in printed and "without DoG (drop)" in printed
    assert np.array_equal(read_ply(tmp_path / "out.ply").log_scales, read_ply(model).log_scales)
    photographs = float(printed.splitlines()[1].split()[-2])
    run(capsys, "eval", model, data, "-o", tmp_path / "measured")
    metrics = json.loads((tmp_path / "measured" / "metrics.json").read_text())["test"]
    assert photographs == pytest.approx(metrics["psnr"], abs=0.01)


def test_the_table_shows_no_loss_where_there_is_none():
    model = tiny_data.truth()
    views = Views(tiny_data.cameras(2), [], 0.0, DrawnAs())
    first, second = losses({"as it is": model, "the same": model}, views)
    assert first == Loss("as it is", None, None)
    assert second.of_model == pytest.approx(100) and second.of_photographs is None


def test_an_export_says_what_it_wrote_and_measures_nothing_when_no_view_is_asked_for(model, tmp_path):
    exported = export_model(model, tmp_path / "out.spz", ExportConfig(views=3, refine=0))
    assert (exported.n_splats, exported.n_views) == (tiny_data.N_TRUTH, 3)
    assert [loss.stage for loss in exported.losses] == ["as it is", "without DoG (bake)", "read from the file"]
    assert exported.losses[0].of_model is None and all(loss.of_photographs is None for loss in exported.losses)
    assert export_model(str(model), str(tmp_path / "out.ply"), ExportConfig(views=0, refine=0)).losses == []


def test_cameras_around_a_model_all_see_its_middle():
    model = tiny_data.truth()
    centre, _ = robust_sphere(model)
    for camera in cameras_around(model, 5):
        pixels, depth = camera.project(centre)
        assert depth > 0 and pixels[0] == pytest.approx([camera.width / 2, camera.height / 2])


def test_a_near_clip_that_is_asked_for_holds_without_data():
    model, asked = tiny_data.truth(), PictureOptions(near_clip=2.0)
    views = [views_of(model, None, 2, options, drawn_as(options.drawing)) for options in (asked, PictureOptions())]
    assert views[0].drawn.near_clip == 2.0 > views[1].drawn.near_clip


@pytest.mark.parametrize("version", ["4", "5"])
def test_a_version_of_spz_that_cannot_be_written_is_told_before_anything_is_refined(
    capsys, model, tmp_path, monkeypatch, version
):
    monkeypatch.setitem(sys.modules, "zstandard", None)
    monkeypatch.setattr("mi_dogsplat.export.write.refined", lambda *_: pytest.fail("it is being refined"))
    command = ["export", model, "-o", tmp_path / "out.spz", "--spz-version", version]
    assert_one_line(run(capsys, *command), "out.spz", f"SPZ {version}")


def test_a_folder_of_the_name_of_the_file_is_told_before_anything_is_refined(capsys, model, tmp_path, monkeypatch):
    monkeypatch.setattr("mi_dogsplat.export.write.refined", lambda *_: pytest.fail("it is being refined"))
    (tmp_path / "out.spz").mkdir()
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "out.spz"), "out.spz", "is a folder")


def test_flags_of_pictures_without_any_are_refused(capsys, model, tmp_path):
    def exported(*flags, out="out.ply"):
        return run(capsys, "export", model, "-o", tmp_path / out, "--dog", "keep", *flags)

    assert_one_line(exported("--downscale", 2), "--downscale", "no images")  # the views around a model have their size
    assert_one_line(exported("--background", "white", "--views", 0), "--background", "no picture")
    data = tiny_data.write_tiny_data(tmp_path / "data")
    assert_one_line(exported("--data", data, "--downscale", 2, "--views", 0), "--downscale", "no images")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["data", "model.ply"]
    assert exported("--background", "auto", "--downscale", 1, "--views", 0)[0] == 0  # which is usual
    assert exported("--background", "white")[0] == 0
    flags = ["--views", 0, "--refine", 0, "--background", "white"]
    assert run(capsys, "export", model, "-o", tmp_path / "page.html", *flags)[0] == 0


def test_a_small_file_is_for_the_model_as_it_lies_and_a_small_page_upright_all_the_same(capsys, model, tmp_path):
    flags = ["--small", "--upright", "--up=z", "--refine", 0, "--views", 0]
    said = run(capsys, "export", model, "-o", tmp_path / "out.spz", *flags)
    assert_one_line(said, "--upright: a small file is refined for the axes of the model; make it upright first")
    assert run(capsys, "export", model, "-o", tmp_path / "page.html", *flags)[0] == 0


def test_data_whose_images_nothing_looks_at_are_told(capsys, model, data, tmp_path):
    command = ["export", model, "-o", tmp_path / "out.ply", "--views", 0, "--dog", "keep", "--data"]
    status, printed, _ = run(capsys, *command, data)
    assert status == 0 and printed.splitlines()[0].startswith("only world.json of --data is used")
    assert_one_line(run(capsys, *command, tmp_path / "none"), "none", "no such file or folder")


def test_a_model_that_is_invisible_cannot_be_refined_and_can_be_written(capsys, tmp_path):
    hidden = tiny_data.truth()
    hidden.logit_opacities[:] = -20
    write_ply(tmp_path / "hidden.ply", hidden)
    command = ["export", tmp_path / "hidden.ply", "-o", tmp_path / "out.sog", "--small", "--views", 0]
    assert_one_line(run(capsys, *command), "hidden.ply", "invisible", "--refine 0")
    assert run(capsys, *command, "--refine", 0)[0] == 0


def test_bad_input_is_one_line_and_nothing_is_left_behind(capsys, model, tmp_path):
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "out.glb", "--small"), "--small", "glTF", ".spz")
    wrong = run(capsys, "export", model, "-o", tmp_path / "out.ply", "--spz-version", "4")
    assert_one_line(wrong, "--spz-version", "PLY", ".spz")
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "out.obj"), "out.obj", ".spz")
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "out.spz", "--dog", "keep"), "--dog", "bake")
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "out.spz", "--views", "-1"), "--views")
    refusals = {("--refine", "-1"): "out of range", ("--refine", "9", "--dog", "keep"): "curvatures, cuts or shifts"}
    for flags, problem in refusals.items():
        assert_one_line(run(capsys, "export", model, "-o", tmp_path / "out.ply", *flags), "--refine", problem)
    assert_one_line(run(capsys, "export", tmp_path / "no.ply", "-o", tmp_path / "out.spz"), "no.ply")
    write_ply(tmp_path / "empty.ply", Splats.empty(1))
    assert_one_line(run(capsys, "export", tmp_path / "empty.ply", "-o", tmp_path / "out.glb"), "empty.ply", "empty")
    before = model.read_bytes()
    assert_one_line(run(capsys, "export", model, "-o", model), "model.ply", "is the model itself")
    assert model.read_bytes() == before
    (tmp_path / "file").touch()
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "file" / "out.spz"), "out.spz", "cannot be written")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["empty.ply", "file", "model.ply"]
