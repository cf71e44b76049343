"""``dogsplat export`` of slopes, curvatures, cuts and shifts: left out with a line and made up for, or kept."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import mi_dogsplat.export.refine as refine
import mi_dogsplat.export.write as write
import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from cut_models import kept_shares, with_cuts, with_second_cuts
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.export.bake import baked
from mi_dogsplat.export.export_config import ExportConfig
from mi_dogsplat.export.stages import stages_of, taken_out
from mi_dogsplat.export.write import export_model
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.formats.write import what_is_lost
from mi_dogsplat.scene.curvatures import mean_brightness
from mi_dogsplat.scene.kinds import kinds_of
from mi_dogsplat.scene.row_groups import CURVATURES, CUTS, PLANES, SECOND_CUTS, SHIFTS, SLOPES
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.whole import whole
from places import points_in
from row_kinds import RowKind, of_each
from shifted_models import with_shifts
from sloped_models import curvature_brightness, slope_colors, with_curvatures, with_slopes
from splat_scenes import C0


@dataclass(frozen=True)
class Kind(RowKind):
    """Rows of half the primitives of one model; of another, in which there are DoG and what comes before them too."""

    setting: str  # that keeps them
    given: tuple[str, ...]  # settings for all that ``mixed`` has beside DoG
    model: Splats
    mixed: Splats
    left_out: Callable[[Splats], Splats]
    said: str  # of what is left out
    regained: float  # dB by refining, at least
    moved: float  # by refining, at most

    @property
    def flag(self) -> str:
        return f"--{self.setting}"


SLOPED_DOG = with_slopes(tiny_data.dog_model(), every=3)
SLOPED = Kind(
    "slopes", SLOPES, "slopes", ("slopes",), with_slopes(tiny_data.truth()), SLOPED_DOG, Splats.without_slopes,
    "the slopes of 30 primitives are left out", regained=0.5, moved=0.1,
)  # fmt: skip
CURVED = Kind(
    "curvatures", CURVATURES, "slopes", ("slopes",), with_curvatures(tiny_data.truth()),
    with_curvatures(SLOPED_DOG, every=4), Splats.without_slopes, "the curvatures of 30 primitives are left out",
    regained=0.1, moved=SLOPED.moved,  # found: 0.28 dB; their mean brightness is not lost
)  # fmt: skip
CUT = Kind(
    "cuts", CUTS, "cuts", ("slopes", "cuts"), with_cuts(tiny_data.truth()), with_cuts(SLOPED_DOG), whole,
    "the cuts of 30 primitives are left out: each becomes the nearest whole primitive", regained=0.1, moved=1,
)  # fmt: skip
BY_SECOND = replace(
    tiny_data.truth(), second_cut_index=CUT.model.cut_index, second_cut_normals=CUT.model.cut_normals
)  # fmt: skip
SECOND_CUT = Kind(
    "second_cuts", SECOND_CUTS, "cuts", CUT.given, BY_SECOND,
    with_second_cuts(CUT.mixed, every=3), whole, CUT.said, CUT.regained, CUT.moved,
)  # fmt: skip
SHIFTED = Kind(
    "shifts", SHIFTS, "shifts", ("slopes", "cuts", "shifts"), tiny_data.shifted_truth(),
    with_shifts(CUT.mixed, every=4), lambda splats: whole(splats.without_shifts()),
    "the shifts of 60 primitives are left out: each has its mean place", regained=0.1, moved=1,
)  # fmt: skip
KINDS = [SLOPED, CURVED, CUT, SECOND_CUT, SHIFTED]
each_kind = of_each(*KINDS)
NO_ROOM = [(kind, ".html") for kind in KINDS] + [
    (kind, suffix) for kind in KINDS for suffix, chosen in FORMATS.items() if not getattr(chosen, kind.setting)
]


def written(splats: Splats, folder: Path, name: str = "model.ply") -> Path:
    write_ply(folder / name, splats)
    return folder / name


def stages(exported) -> list[str]:
    return [loss.stage for loss in exported.losses]


@each_kind
@pytest.mark.parametrize("suffix", [*FORMATS, ".html"])
def test_every_format_is_without_them_unless_told_and_a_line_says_so(kind, suffix, capsys, tmp_path):
    out = tmp_path / f"out{suffix}"
    model = written(kind.model, tmp_path)
    status, printed, _ = run(capsys, "export", model, "-o", out, "--views", "0", "--refine", "0")
    assert status == 0
    left = [line for line in printed.splitlines() if "left out" in line]
    assert len(left) == 1 and left[0].startswith(kind.said), printed
    assert (f"{kind.flag} keep" in left[0]) == (suffix in (".ply", ".compressed.ply"))
    if suffix != ".html":
        assert kind.n(read_model(out).splats) == 0
    if suffix == ".ply":
        found, expected = read_ply(out), kind.left_out(kind.model)
        for name in ("means", "sh_coeffs"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.parametrize(
    ("slopes", "curvatures", "said"),
    [
        ([0], [], "the slopes of 1 primitive are left out: each has its mean colour"),
        ([], [0, 2], "the curvatures of 2 primitives are left out"),
        ([0, 1], [1, 2], "the slopes and curvatures of 3 primitives are left out"),
    ],
)
def test_the_line_names_what_there_is(slopes, curvatures, said):
    model = replace(tiny_data.truth(), slope_index=slopes, color_slopes=np.ones((len(slopes), 3, 3)))
    model = replace(model, curvature_index=curvatures, brightness_curvatures=np.ones((len(curvatures), 6)))
    (line,) = taken_out(stages_of(model, ExportConfig()), FORMATS[".spz"])
    assert line.startswith(said)
    (line,) = what_is_lost(FORMATS[".spz"], Model(model))
    assert said.split(" of ")[0] in line


@each_kind
def test_each_thing_that_is_left_out_is_a_stage_of_its_own_in_this_order(kind, tmp_path):
    model = written(kind.mixed, tmp_path, "mixed.ply")
    exported = export_model(model, tmp_path / "out.spz", ExportConfig(views=3, refine=0))
    dropped = [f"without {word}" for word in reversed(kind.given)]
    assert stages(exported) == ["as it is", *dropped, "without DoG (bake)", "read from the file"]
    losses = [loss.of_model or 0 for loss in exported.losses[1:-1]]
    assert all(15 < worse < better < 60 for better, worse in pairwise(losses))
    export_model(model, tmp_path / "out.ply", ExportConfig(views=3, refine=0))
    found, expected = read_ply(tmp_path / "out.ply"), baked(kind.left_out(kind.mixed).without_slopes())
    for name in ("logit_opacities", "sh_coeffs"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@each_kind
def test_refining_makes_up_for_them(kind, tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data", splats=kind.model)
    exported = export_model(written(kind.model, tmp_path), tmp_path / "out.ply", ExportConfig(refine=60), data=data)
    found = {loss.stage: loss.of_photographs or 0 for loss in exported.losses}
    assert list(found) == ["as it is", f"without {kind.setting}", "refined, 60 steps", "read from the file"]
    assert found["refined, 60 steps"] > found[f"without {kind.setting}"] + kind.regained
    assert kind.n(read_ply(tmp_path / "out.ply")) == 0


def test_without_data_they_are_made_up_for_by_renders_of_the_model(tmp_path):
    exported = export_model(written(SLOPED.model, tmp_path), tmp_path / "out.ply", ExportConfig(views=4, refine=60))
    found = {loss.stage: loss.of_model or 0 for loss in exported.losses}
    assert found["refined, 60 steps"] > found["without slopes"]


@each_kind
def test_by_default_they_are_made_up_for(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(refine, "STEPS", 2)
    exported = export_model(written(kind.model, tmp_path), tmp_path / "out.ply", ExportConfig(views=1))
    assert stages(exported) == ["as it is", f"without {kind.setting}", "refined, 2 steps", "read from the file"]


def test_by_default_nothing_is_made_up_for_where_dog_are_just_dropped(tmp_path, monkeypatch):
    model, mixed = written(SLOPED.model, tmp_path), written(SLOPED.mixed, tmp_path, "mixed.ply")
    monkeypatch.setattr(refine, "STEPS", 2)
    for path, dog, steps in ((model, "bake", True), (mixed, "bake", True), (mixed, "keep", True),
                             (model, "drop", False), (mixed, "drop", False)):  # fmt: skip
        exported = export_model(path, tmp_path / "out.ply", ExportConfig(dog=dog, views=1))
        assert ("refined, 2 steps" in stages(exported)) == steps, (path, dog)
        assert read_ply(tmp_path / "out.ply").n_dog == (30 if dog == "keep" else 0)
    monkeypatch.setattr(write, "mi", type("mi", (), {"variant": staticmethod(lambda: None)}))
    assert export_model(model, tmp_path / "out.ply", ExportConfig(views=0)).refine_seconds is None


@each_kind
def test_kept_ones_are_refined_along_where_dog_are_baked(kind, tmp_path):
    keep: dict[str, Any] = dict.fromkeys(kind.given, "keep")
    config = ExportConfig(views=3, refine=40, **keep)
    exported = export_model(written(kind.mixed, tmp_path), tmp_path / "out.ply", config)
    assert stages(exported) == ["as it is", "without DoG (bake)", "refined, 40 steps", "read from the file"]
    assert (exported.losses[2].of_model or 0) > (exported.losses[1].of_model or 0) and not exported.left_out
    found, start = read_ply(tmp_path / "out.ply"), baked(kind.mixed)
    np.testing.assert_array_equal(kind.index(found), kind.index(kind.mixed))
    moved = np.abs(kind.values(found) - kind.values(start))
    assert found.n_dog == 0 and 0 < moved.max() < kind.moved


@each_kind
@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply"])
def test_kept_ones_are_in_the_file(kind, suffix, capsys, tmp_path):
    out = tmp_path / f"out{suffix}"
    keep = [word for name in (*kind.given, "dog") for word in (f"--{name}", "keep")]
    status, printed, _ = run(capsys, "export", written(kind.mixed, tmp_path), "-o", out, *keep, "--views", "2")
    assert status == 0 and "left out" not in printed and "refined" not in printed
    assert f"without {kind.setting}" not in printed
    back = read_model(out).splats
    assert kinds_of(back) == kinds_of(kind.mixed)
    if suffix == ".ply":
        np.testing.assert_array_equal(kind.values(back), kind.values(kind.mixed))
    lost = float(re.findall(r"read from the file +([\d.]+) dB", printed)[0])
    assert lost > (99 if suffix == ".ply" else 30)


@pytest.mark.parametrize(
    ("flag", "left"),
    [("--slopes", "20 with slopes, 12 with curvatures"), ("--cuts", "30 with a cut, 20 with a second cut"),
     ("--shifts", "15 with shifts")],
)
def test_each_is_kept_by_its_own_flag(flag, left, capsys, tmp_path):
    splats = with_shifts(with_curvatures(SECOND_CUT.mixed, every=5), every=4)
    out, mixed = tmp_path / "out.ply", written(splats, tmp_path)
    status, *_ = run(capsys, "export", mixed, "-o", out, flag, "keep", "--views", "0", "--refine", "0")
    assert status == 0 and kinds_of(read_ply(out)) == f"0 of them DoG, {left}"


@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_what_is_left_of_curvatures_is_how_bright_they_are_on_average(suffix, tmp_path):
    model, out = CURVED.model, tmp_path / f"out{suffix}"
    export_model(written(model, tmp_path), out, ExportConfig(views=0, refine=0))
    brighter = np.zeros(model.n_splats)
    brighter[model.curvature_index] = mean_brightness(
        model.brightness_curvatures, model.log_scales[model.curvature_index]
    )
    found = read_model(out).splats.sh_coeffs[:, 0] - model.sh_coeffs[:, 0]
    np.testing.assert_allclose(C0 * found, np.repeat(brighter[:, None], 3, 1), atol=1e-6)
    assert np.abs(brighter).max() > 0.1


def test_what_is_kept_of_baked_dog_stays_where_it_was_in_space():
    splats = with_second_cuts(with_cuts(with_slopes(tiny_data.dog_model(), every=1), every=1), every=1)
    splats = with_curvatures(splats, every=1)
    found = baked(splats)
    points = points_in(splats)
    assert np.abs(found.log_scales - splats.log_scales).max() > 0.1
    for plane in PLANES:
        np.testing.assert_allclose(kept_shares(found, points, plane), kept_shares(splats, points, plane), atol=1e-4)
    for shown_at in (slope_colors, curvature_brightness):
        np.testing.assert_allclose(shown_at(found, points), shown_at(splats, points), atol=1e-5)


def page_of(splats: Splats, capsys, folder: Path) -> str:
    out = folder / "page.html"
    run(capsys, "export", written(splats, folder), "-o", out, "--views", "0", "--refine", "0")
    return out.read_text()


def test_a_page_says_that_slopes_are_shown_in_their_mean_colours(capsys, tmp_path):
    said = page_of(SLOPED.model, capsys, tmp_path)
    assert "model: 60 Gaussians (30 with colours that varied over them, in their mean colours)" in said
    assert "Web viewers know no colours that vary over a Gaussian: these are shown in their mean colours, so" in said
    said = page_of(SLOPED.mixed, capsys, tmp_path)
    assert "30 of them Differences of Gaussians, baked; 20 with colours that varied over them" in said
    assert "no negative lobes and no colours that vary over a Gaussian: each Difference of Gaussians is" in said
    assert json.loads(re.search(r'id="scene">([^<]*)<', said)[1])["tangents"]  # type: ignore[index]


@of_each(CUT, SECOND_CUT)
def test_a_page_says_that_cut_ones_are_shown_whole(kind, capsys, tmp_path):
    said = page_of(kind.model, capsys, tmp_path)
    assert "model: 60 Gaussians (30 that were cut off, made whole)" in said
    assert "Web viewers know no Gaussians that a plane cuts off: each of those is shown as the nearest whole" in said
    said = page_of(kind.mixed, capsys, tmp_path)
    cut = kind.mixed.is_cut.sum()
    assert f"baked; 20 with colours that varied over them, in their mean colours; {cut} that were cut off" in said
    assert "no negative lobes, no colours that vary over a Gaussian and no Gaussians that a plane cuts off:" in said


def test_a_page_says_that_places_are_mean_ones(capsys, tmp_path):
    said = page_of(SHIFTED.model, capsys, tmp_path)
    assert "model: 60 Gaussians (60 whose places depended on the view, at their mean places)" in said
    assert "Web viewers know no places that depend on the view: Gaussians with such places are shown at their" in said
    said = page_of(SHIFTED.mixed, capsys, tmp_path)
    assert "30 that were cut off, made whole; 15 whose places depended on the view, at their mean places)" in said
    assert "no Gaussians that a plane cuts off and no places that depend on the view: each Difference" in said


@pytest.mark.parametrize(("kind", "suffix"), NO_ROOM, ids=lambda value: getattr(value, "word", value))
def test_they_cannot_be_kept_where_there_is_no_room(kind, suffix, capsys, tmp_path):
    model = written(kind.model, tmp_path)
    refused = run(capsys, "export", model, "-o", tmp_path / f"out{suffix}", kind.flag, "keep")
    assert_one_line(refused, kind.flag, "cannot hold them", "use drop")
    assert [path.name for path in tmp_path.iterdir()] == ["model.ply"]


@each_kind
def test_an_unknown_choice_is_one_line(kind, capsys, tmp_path):
    model = written(kind.model, tmp_path)
    refused = run(capsys, "export", model, "-o", tmp_path / "out.ply", kind.flag, "bake")
    assert_one_line(refused, kind.flag, "unknown")
