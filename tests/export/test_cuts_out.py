"""``dogsplat export`` of primitives that a plane cuts off: made whole with a line and made up for, or kept."""

import re

import mi_dogsplat.export.refine as refine
import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from cut_models import kept_shares, with_cuts
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.export.bake import baked
from mi_dogsplat.export.write import export_model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.scene.whole import whole
from sloped_models import points_in, slope_colors, with_slopes

MODEL = with_cuts(tiny_data.truth())
MIXED = with_cuts(with_slopes(tiny_data.dog_model(), every=3))
NO_ROOM = [*(suffix for suffix, chosen in FORMATS.items() if not chosen.cuts), ".html"]


@pytest.fixture
def model(tmp_path):
    write_ply(tmp_path / "model.ply", MODEL)
    return tmp_path / "model.ply"


@pytest.fixture
def mixed(tmp_path):
    write_ply(tmp_path / "mixed.ply", MIXED)
    return tmp_path / "mixed.ply"


@pytest.mark.parametrize("suffix", [*FORMATS, ".html"])
def test_every_format_has_whole_ones_unless_told_and_a_line_says_so(capsys, model, tmp_path, suffix):
    out = tmp_path / f"out{suffix}"
    status, printed, _ = run(capsys, "export", model, "-o", out, "--views", "0", "--refine", "0")
    assert status == 0
    left = [line for line in printed.splitlines() if "cut" in line]
    assert len(left) == 1 and left[0].startswith("the cuts of 30 primitives are left out, for the whole ones"), printed
    assert ("--cuts keep" in left[0]) == (suffix in (".ply", ".compressed.ply"))
    if suffix == ".ply":
        found, expected = read_ply(out), whole(MODEL)
        assert found.n_cuts == 0
        np.testing.assert_array_equal(found.means, expected.means)
    elif suffix != ".html":
        assert read_model(out).splats.n_cuts == 0


def test_each_thing_that_is_left_out_is_a_stage_of_its_own_and_cuts_come_first(mixed, tmp_path):
    exported = export_model(mixed, tmp_path / "out.spz", views=3, refine=0)
    stages = [loss.stage for loss in exported.losses]
    assert stages == ["as it is", "without cuts", "without slopes", "without DoG (bake)", "read from the file"]
    exported = export_model(mixed, tmp_path / "out.ply", views=3, refine=0)
    expected = baked(whole(MIXED).without_slopes())
    np.testing.assert_array_equal(read_ply(tmp_path / "out.ply").sh_coeffs, expected.sh_coeffs)


def test_refining_makes_up_for_them(model, tmp_path, monkeypatch):
    monkeypatch.setattr(tiny_data, "truth", lambda: MODEL)
    data = tiny_data.write_tiny_data(tmp_path / "data")
    exported = export_model(model, tmp_path / "out.ply", data=data, refine=60)
    found = {loss.stage: loss.of_photographs or 0 for loss in exported.losses}
    assert list(found) == ["as it is", "without cuts", "refined, 60 steps", "read from the file"]
    assert found["refined, 60 steps"] > found["without cuts"] + 0.1


def test_by_default_they_are_made_up_for(model, tmp_path, monkeypatch):
    monkeypatch.setattr(refine, "STEPS", 2)
    stages = [loss.stage for loss in export_model(model, tmp_path / "out.ply", views=1).losses]
    assert stages == ["as it is", "without cuts", "refined, 2 steps", "read from the file"]


def test_kept_ones_are_refined_along_where_dog_are_baked(mixed, tmp_path):
    exported = export_model(mixed, tmp_path / "out.ply", views=3, refine=40, slopes="keep", cuts="keep")
    stages = [loss.stage for loss in exported.losses]
    assert stages == ["as it is", "without DoG (bake)", "refined, 40 steps", "read from the file"]
    assert (exported.losses[2].of_model or 0) > (exported.losses[1].of_model or 0) and not exported.left_out
    found, start = read_ply(tmp_path / "out.ply"), baked(MIXED)
    np.testing.assert_array_equal(found.cut_index, MIXED.cut_index)
    moved = np.abs(found.cut_normals - start.cut_normals)
    assert found.n_dog == 0 and 0 < moved.max() < 3


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply"])
def test_kept_ones_are_in_the_file(capsys, mixed, tmp_path, suffix):
    out = tmp_path / f"out{suffix}"
    flags = "--cuts", "keep", "--slopes", "keep", "--dog", "keep", "--views", "2"
    status, printed, _ = run(capsys, "export", mixed, "-o", out, *flags)
    assert status == 0 and "left out" not in printed and "refined" not in printed and "without cuts" not in printed
    back = read_model(out).splats
    assert (back.n_cuts, back.n_slopes, back.n_dog) == (MIXED.n_cuts, MIXED.n_slopes, MIXED.n_dog)
    if suffix == ".ply":
        np.testing.assert_array_equal(back.cut_normals, MIXED.cut_normals)
    lost = float(re.findall(r"read from the file +([\d.]+) dB", printed)[0])
    assert lost > (99 if suffix == ".ply" else 30)


@pytest.mark.parametrize(("flags", "slopes", "cuts"), [(("--slopes",), 20, 0), (("--cuts",), 0, 30)])
def test_each_is_kept_by_its_own_flag(capsys, mixed, tmp_path, flags, slopes, cuts):
    out = tmp_path / "out.ply"
    status, *_ = run(capsys, "export", mixed, "-o", out, *flags, "keep", "--views", "0", "--refine", "0")
    assert status == 0 and (read_ply(out).n_slopes, read_ply(out).n_cuts) == (slopes, cuts)


def test_what_is_kept_of_baked_dog_stays_where_it_was_in_space():
    splats = with_cuts(with_slopes(tiny_data.dog_model(), every=1), every=1)
    found = baked(splats)
    points = points_in(splats)
    assert np.abs(found.log_scales - splats.log_scales).max() > 0.1
    np.testing.assert_allclose(kept_shares(found, points), kept_shares(splats, points), atol=1e-4)
    np.testing.assert_allclose(slope_colors(found, points), slope_colors(splats, points), atol=1e-5)


def test_a_page_says_that_they_are_shown_whole(capsys, model, mixed, tmp_path):
    out = tmp_path / "page.html"
    run(capsys, "export", model, "-o", out, "--views", "0", "--refine", "0")
    said = out.read_text()
    assert "model: 60 Gaussians (30 that were cut off, made whole)" in said
    assert "Web viewers know no Gaussians that a plane cuts off: each of those is shown as the whole one" in said
    run(capsys, "export", mixed, "-o", out, "--views", "0", "--refine", "0")
    said = out.read_text()
    assert "baked; 20 with colours that varied over them, in their mean colours; 30 that were cut off" in said
    assert "no negative lobes, no colours that vary over a Gaussian and no Gaussians that a plane cuts off:" in said


@pytest.mark.parametrize("suffix", NO_ROOM)
def test_they_cannot_be_kept_where_there_is_no_room(capsys, model, tmp_path, suffix):
    refused = run(capsys, "export", model, "-o", tmp_path / f"out{suffix}", "--cuts", "keep")
    assert_one_line(refused, "--cuts", "has no room for them", "use drop")
    assert [path.name for path in tmp_path.iterdir()] == ["model.ply"]


def test_an_unknown_choice_is_one_line(capsys, model, tmp_path):
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "out.ply", "--cuts", "bake"), "--cuts", "unknown")
