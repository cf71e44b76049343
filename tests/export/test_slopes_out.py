"""``dogsplat export`` of colours that vary over their primitive: dropped with a line and made up for, or kept."""

import json
import re

import mi_dogsplat.export.refine as refine
import mi_dogsplat.export.write as write
import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.export.bake import baked
from mi_dogsplat.export.write import export_model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.table import FORMATS
from sloped_models import with_slopes

MODEL, MIXED = with_slopes(tiny_data.truth()), with_slopes(tiny_data.dog_model(), every=3)
NO_ROOM = [*(suffix for suffix, chosen in FORMATS.items() if not chosen.slopes), ".html"]


@pytest.fixture
def model(tmp_path):
    write_ply(tmp_path / "model.ply", MODEL)
    return tmp_path / "model.ply"


@pytest.fixture
def mixed(tmp_path):
    write_ply(tmp_path / "mixed.ply", MIXED)
    return tmp_path / "mixed.ply"


def stages(exported) -> list[str]:
    return [loss.stage for loss in exported.losses]


@pytest.mark.parametrize("suffix", [*FORMATS, ".html"])
def test_every_format_has_mean_colours_unless_told_and_a_line_says_so(capsys, model, tmp_path, suffix):
    out = tmp_path / f"out{suffix}"
    status, printed, _ = run(capsys, "export", model, "-o", out, "--views", "0", "--refine", "0")
    assert status == 0
    left = [line for line in printed.splitlines() if "slopes" in line]
    assert len(left) == 1 and left[0].startswith("the slopes of 30 primitives are left out"), printed
    assert ("--slopes keep" in left[0]) == (suffix in (".ply", ".compressed.ply"))
    if suffix != ".html":
        assert read_model(out).splats.n_slopes == 0


def test_the_loss_of_what_is_dropped_is_a_stage_of_its_own(mixed, tmp_path):
    exported = export_model(mixed, tmp_path / "out.spz", views=3, refine=0)
    assert stages(exported) == ["as it is", "without slopes", "without DoG (bake)", "read from the file"]
    loss = [loss.of_model or 0 for loss in exported.losses[1:]]
    assert 15 < loss[1] < loss[0] < 60
    exported = export_model(mixed, tmp_path / "out.ply", views=3, refine=0)
    expected = baked(MIXED.without_slopes())
    np.testing.assert_array_equal(read_ply(tmp_path / "out.ply").logit_opacities, expected.logit_opacities)


def test_refining_makes_up_for_dropped_slopes(model, tmp_path, monkeypatch):
    monkeypatch.setattr(tiny_data, "truth", lambda: MODEL)
    data = tiny_data.write_tiny_data(tmp_path / "data")
    exported = export_model(model, tmp_path / "out.ply", data=data, refine=60)
    found = {loss.stage: loss.of_photographs or 0 for loss in exported.losses}
    assert list(found) == ["as it is", "without slopes", "refined, 60 steps", "read from the file"]
    assert found["refined, 60 steps"] > found["without slopes"] + 0.5
    assert read_ply(tmp_path / "out.ply").n_slopes == 0


def test_without_data_they_are_made_up_for_by_renders_of_the_model(model, tmp_path):
    exported = export_model(model, tmp_path / "out.ply", views=4, refine=60)
    found = {loss.stage: loss.of_model or 0 for loss in exported.losses}
    assert found["refined, 60 steps"] > found["without slopes"]


def test_by_default_they_are_made_up_for_unless_dog_are_just_dropped(model, mixed, tmp_path, monkeypatch):
    monkeypatch.setattr(refine, "STEPS", 2)
    for path, dog, steps in ((model, "bake", True), (mixed, "bake", True), (mixed, "keep", True),
                             (model, "drop", False), (mixed, "drop", False)):  # fmt: skip
        exported = export_model(path, tmp_path / "out.ply", dog=dog, views=1)
        assert ("refined, 2 steps" in stages(exported)) == steps, (path, dog)
        assert read_ply(tmp_path / "out.ply").n_dog == (30 if dog == "keep" else 0)
    monkeypatch.setattr(write, "mi", type("mi", (), {"variant": staticmethod(lambda: None)}))
    assert export_model(model, tmp_path / "out.ply", views=0).refine_seconds is None


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply"])
def test_kept_ones_are_in_the_file(capsys, mixed, tmp_path, suffix):
    out = tmp_path / f"out{suffix}"
    flags = "--slopes", "keep", "--dog", "keep", "--views", "2"
    status, printed, _ = run(capsys, "export", mixed, "-o", out, *flags)
    assert status == 0 and "left out" not in printed and "refined" not in printed and "without slopes" not in printed
    back = read_model(out).splats
    assert back.n_slopes == MIXED.n_slopes and back.n_dog == MIXED.n_dog
    if suffix == ".ply":
        np.testing.assert_array_equal(back.color_slopes, MIXED.color_slopes)
    lost = float(re.findall(r"read from the file +([\d.]+) dB", printed)[0])
    assert lost > (99 if suffix == ".ply" else 30)


def test_kept_ones_are_refined_along_where_dog_are_baked(mixed, tmp_path):
    exported = export_model(mixed, tmp_path / "out.ply", views=3, refine=40, slopes="keep")
    assert stages(exported) == ["as it is", "without DoG (bake)", "refined, 40 steps", "read from the file"]
    assert (exported.losses[2].of_model or 0) > (exported.losses[1].of_model or 0) and not exported.left_out
    found = read_ply(tmp_path / "out.ply")
    np.testing.assert_array_equal(found.slope_index, MIXED.slope_index)
    moved = np.abs(found.color_slopes - MIXED.color_slopes)
    assert found.n_dog == 0 and 0 < moved.max() < 0.5


def test_a_page_says_that_they_are_shown_in_their_mean_colours(capsys, model, mixed, tmp_path):
    out = tmp_path / "page.html"
    run(capsys, "export", model, "-o", out, "--views", "0", "--refine", "0")
    said = out.read_text()
    assert "model: 60 Gaussians (30 with colours that varied over them, in their mean colours)" in said
    assert "Web viewers know no colours that vary over a Gaussian: these are shown in their mean colours, so" in said
    run(capsys, "export", mixed, "-o", out, "--views", "0", "--refine", "0")
    said = out.read_text()
    assert "30 of them Differences of Gaussians, baked; 20 with colours that varied over them" in said
    assert "no negative lobes and no colours that vary over a Gaussian: each Difference of Gaussians is" in said
    assert json.loads(re.search(r'id="scene">([^<]*)<', said)[1])["tangents"]  # type: ignore[index]


@pytest.mark.parametrize("suffix", NO_ROOM)
def test_they_cannot_be_kept_where_there_is_no_room(capsys, model, tmp_path, suffix):
    refused = run(capsys, "export", model, "-o", tmp_path / f"out{suffix}", "--slopes", "keep")
    assert_one_line(refused, "--slopes", "has no room for them", "use drop")
    assert [path.name for path in tmp_path.iterdir()] == ["model.ply"]


def test_an_unknown_choice_is_one_line(capsys, model, tmp_path):
    assert_one_line(run(capsys, "export", model, "-o", tmp_path / "out.ply", "--slopes", "bake"), "--slopes", "unknown")
