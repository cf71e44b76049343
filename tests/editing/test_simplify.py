"""``dogsplat simplify``: so many primitives as asked for, nearer to the model the more is done; bad input in a line."""

import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.editing.simplify import look_of, simplify_model
from mi_dogsplat.editing.simplify_config import SimplifyConfig
from mi_dogsplat.export.refine import rendered
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.scene.drawing import Drawing
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.fit import Look
from own_axes_models import CURVED, EACH_PLANE, SLOPED
from row_kinds import of_each
from shifted_models import with_shifts
from splat_scenes import make_splats, rounded

FAST = {"views": 8, "size": (40, 30)}
FLAGS = ["--views", "8", "--size", "40", "30"]


def surface(n=900) -> Splats:
    """A striped ball of small discs."""
    k = np.arange(n) + 0.5
    z, angle = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
    points = np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], 1)
    return rounded(make_splats(points * 0.7, 0.03, 0.9, np.where(np.sin(9 * z)[:, None] > 0, [1, 0.2, 0], [0, 0.4, 1])))


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model.ply"
    write_ply(path, surface())
    return path


def quality(found: Splats, truth: Splats) -> float:
    """PSNR in dB from cameras of the tests' own."""
    look, cameras = Look(0.5), tiny_data.cameras()
    pairs = zip(rendered(found, cameras, look), rendered(truth, cameras, look), strict=True)
    return float(np.mean([psnr(a, b) for a, b in pairs]))


@pytest.mark.parametrize("target, n", [("10%", 90), ("0.05", 45), ("20", 20), ("12.5%", 112)])
def test_a_target_is_a_ratio_or_a_count(model, tmp_path, target, n):
    found = simplify_model(model, tmp_path / "o.ply", SimplifyConfig(target=target, steps=0, **FAST))
    assert found.n_after == n == read_ply(tmp_path / "o.ply").n_splats
    assert found.n_before == 900 and found.fitted is None


def test_merging_keeps_more_than_leaving_out_and_the_fit_more_than_merging(model, tmp_path):
    truth = surface()
    simplify_model(model, tmp_path / "merged.ply", SimplifyConfig(target="60", steps=0, **FAST))
    told = simplify_model(model, tmp_path / "fitted.ply", SimplifyConfig(target="60", steps=150, **FAST))
    every = truth.select(np.arange(0, 900, 15))
    merged, fitted = (quality(read_ply(tmp_path / name), truth) for name in ("merged.ply", "fitted.ply"))
    assert quality(every, truth) + 3 < merged < fitted - 1
    assert told.fitted is not None and told.merged < told.fitted


def test_the_same_model_comes_of_the_same_seed(ordered, model, tmp_path):
    config = SimplifyConfig(target="30", steps=6, **FAST)
    for name in ("a.ply", "b.ply"):
        simplify_model(model, tmp_path / name, config)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_the_command_says_how_near_it_is_and_shows_its_steps(capsys, model, tmp_path):
    flags = ["--target", "5%", "--steps", "4", *FLAGS]
    status, printed, bar = run(capsys, "simplify", model, "-o", tmp_path / "o.ply", *flags)
    lines = printed.splitlines()
    assert status == 0 and "4/4" in bar
    assert lines[0] == "PSNR of the model, over 16 views to which nothing was fitted"
    assert lines[1].startswith("  merged ") and lines[2].startswith("  fitted ") and lines[1].endswith(" dB")
    assert lines[3].startswith(f"{tmp_path / 'o.ply'}: 45 primitives, ")


def test_dog_are_fitted_if_asked_for_and_a_dog_model_may_come_in(capsys, tmp_path):
    write_ply(tmp_path / "dog.ply", tiny_data.dog_model())
    for flags, dog in (([], False), (["--dog"], True)):
        argv = ["simplify", tmp_path / "dog.ply", "-o", tmp_path / "o.ply", "--target", "20", "--steps", "6"]
        status, *_ = run(capsys, *argv, *FLAGS, *flags)
        found = read_ply(tmp_path / "o.ply")
        assert status == 0 and found.n_splats == 20 and bool(found.n_dog) == dog


@of_each(SLOPED, CURVED)
def test_a_model_with_slopes_or_curvatures_may_come_in_and_what_is_fitted_makes_up_for_them(capsys, tmp_path, kind):
    truth = kind.having(surface(), every=1)
    # What is merged would see slopes too, were they all different. Curvatures make a blend brighter than their average.
    kind.values(truth)[:] = kind.values(truth)[:1] * 2 if kind is SLOPED else [0.5, 0.5, 0.5, 0, 0, 0]
    write_ply(tmp_path / "m.ply", truth)
    write_ply(tmp_path / "flat.ply", truth.without_slopes())
    flags = ["--target", "60", *FLAGS]
    status, printed, _ = run(capsys, "simplify", tmp_path / "m.ply", "-o", tmp_path / "o.ply", "--steps", "60", *flags)
    said = f"the {kind.word} of 900 primitives are left out: merged primitives have one mean colour"
    assert status == 0 and printed.splitlines()[0] == said and kind.n(read_ply(tmp_path / "o.ply")) == 0
    _, printed, _ = run(capsys, "simplify", tmp_path / "flat.ply", "-o", tmp_path / "p.ply", "--steps", "60", *flags)
    assert "left out" not in printed
    assert quality(read_ply(tmp_path / "o.ply"), truth) > quality(read_ply(tmp_path / "p.ply"), truth)


@EACH_PLANE
def test_cuts_are_made_whole_before_anything_is_merged(capsys, tmp_path, kind):
    """Half of each primitive is cut away on the same side: whole ones would be merged elsewhere, and too large."""
    truth = kind.having(surface(), every=1)
    kind.values(truth)[:] = [30, 0, 0]
    truth.log_scales[:] += np.log(2)
    write_ply(tmp_path / "m.ply", truth)
    write_ply(tmp_path / "whole.ply", truth.without_cuts())
    flags = ["--target", "300", "--steps", "0", *FLAGS]
    status, printed, _ = run(capsys, "simplify", tmp_path / "m.ply", "-o", tmp_path / "o.ply", *flags)
    said = "the cuts of 900 primitives are left out: merged primitives are whole"
    assert status == 0 and printed.splitlines()[0] == said and not read_ply(tmp_path / "o.ply").is_cut.any()
    run(capsys, "simplify", tmp_path / "whole.ply", "-o", tmp_path / "p.ply", *flags)
    assert quality(read_ply(tmp_path / "o.ply"), truth) > quality(read_ply(tmp_path / "p.ply"), truth) + 1


def test_a_model_with_shifts_may_come_in_and_what_is_merged_stands_still(capsys, tmp_path):
    truth = with_shifts(surface(), every=1)
    write_ply(tmp_path / "m.ply", truth)
    write_ply(tmp_path / "still.ply", truth.without_shifts())
    flags = ["--target", "60", "--steps", "0", *FLAGS]
    status, printed, _ = run(capsys, "simplify", tmp_path / "m.ply", "-o", tmp_path / "o.ply", *flags)
    said = "the shifts of 900 primitives are left out: merged primitives do not move with the view"
    assert status == 0 and printed.splitlines()[0] == said
    _, printed, _ = run(capsys, "simplify", tmp_path / "still.ply", "-o", tmp_path / "p.ply", *flags)
    assert "left out" not in printed
    assert (tmp_path / "o.ply").read_bytes() == (tmp_path / "p.ply").read_bytes()


def test_what_is_not_needed_is_not_merged_into_what_is_seen(tmp_path):
    """Invisible primitives of another colour change nothing."""
    seen = surface()
    hidden = seen.select(np.arange(0, 900, 2))
    hidden.logit_opacities[:], hidden.sh_coeffs[:] = -9, 5
    names = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs")
    both = Splats(**{name: np.concatenate([getattr(seen, name), getattr(hidden, name)]) for name in names})
    for name, model in (("seen", seen), ("both", both)):
        write_ply(tmp_path / f"{name}.ply", model)
        config = SimplifyConfig(target="50", steps=0, **FAST)
        simplify_model(tmp_path / f"{name}.ply", tmp_path / f"{name}_few.ply", config)
    few = read_ply(tmp_path / "both_few.ply")
    assert few.n_splats == 50 and few.sh_coeffs.max() < 4
    assert quality(few, seen) > quality(read_ply(tmp_path / "seen_few.ply"), seen) - 1


@pytest.mark.parametrize("log_scale", [200, 1e4, 3e38])
def test_one_of_any_size_is_merged_with_the_others(tmp_path, log_scale):
    """A training that went wrong leaves one whose variance, or the product of whose variances, no float64 can say."""
    exploded = surface(60)
    exploded.log_scales[7] = log_scale
    write_ply(tmp_path / "model.ply", exploded)
    simplify_model(tmp_path / "model.ply", tmp_path / "few.ply", SimplifyConfig(target="30", steps=0, **FAST))
    assert read_ply(tmp_path / "few.ply").n_splats == 30


def test_the_unit_of_radiance_does_not_matter(tmp_path):
    """What is merged goes by differences of colours, which are as large as the white is."""
    found = {}
    for white in (1.0, 0.001):
        drawing, out = Drawing(linear=True, white=white), tmp_path / f"{white}_few.ply"
        write_model(tmp_path / f"{white}.ply", Model(brightened(surface(), white), drawing))
        told = simplify_model(tmp_path / f"{white}.ply", out, SimplifyConfig(target="90", steps=0, **FAST))
        found[white] = brightened(read_model(out).splats, 1 / white), told.merged
    (one, merged), (other, as_well) = found.values()
    assert merged == pytest.approx(as_well, abs=0.05)
    assert quality(one, surface()) == pytest.approx(quality(other, surface()), abs=0.05)


@pytest.mark.parametrize(
    "flags, words",
    [
        (["--target", "0"], ["--target", "0 is not a target", "10%"]),
        (["--target", "100%"], ["--target", "100%"]),
        (["--target", "-5"], ["--target"]),
        (["--target", "2.5"], ["--target", "2.5"]),
        (["--target", "nan"], ["--target", "nan"]),
        (["--target", "few"], ["--target", "few"]),
        (["--target", "0.01%"], ["--target", "leaves none"]),
        (["--target", "900"], ["--target", "not below the 900"]),
        (["--steps", "-1"], ["--steps", "at least 0"]),
        (["--views", "1"], ["--views", "at least 2"]),
        (["--inside", "2"], ["--inside", "0 to 1"]),
        (["--size", "8", "8"], ["--size", "too small"]),
        (["--dog", "--steps", "1"], ["--dog"]),
        (["--background", "green"], ["--background"]),
        (["--target", "2MB"], ["--target", "2MB", "whole number"]),
    ],
    ids=lambda value: " ".join(value) if value[0][:2] == "--" else "",
)
def test_wrong_use_is_one_line_and_writes_nothing(capsys, model, tmp_path, flags, words):
    assert_one_line(run(capsys, "simplify", model, "-o", tmp_path / "o.ply", *flags), *words)
    assert not (tmp_path / "o.ply").exists()


def test_files_that_cannot_be_simplified_are_one_line(capsys, model, tmp_path):
    out = tmp_path / "o.ply"
    assert_one_line(run(capsys, "simplify", tmp_path / "none.ply", "-o", out), "none.ply")
    assert_one_line(run(capsys, "simplify", model, "-o", model), "model.ply", "would be lost")
    write_ply(tmp_path / "empty.ply", Splats.empty(0))
    assert_one_line(run(capsys, "simplify", tmp_path / "empty.ply", "-o", out), "empty.ply", "the model is empty")
    faint = surface()
    faint.logit_opacities[:] = -9
    write_ply(tmp_path / "faint.ply", faint)
    for steps in ("0", "2"):
        said = run(capsys, "simplify", tmp_path / "faint.ply", "-o", out, "--steps", steps, *FLAGS)
        assert_one_line(said, "faint.ply", "all of its primitives are invisible")
    assert not out.exists()
    assert_one_line(run(capsys, "simplify", model, "-o", tmp_path / "o.obj"), "o.obj")
    assert_one_line(run(capsys, "simplify", model, "-o", tmp_path / "o.spz", "--dog"), "--dog", "SPZ cannot hold DoG")


def test_options_choose_the_background():
    chosen = {name: look_of(surface(), PictureOptions(background=name)).background for name in ("black", "white")}
    assert chosen == {"black": 0.0, "white": 1.0}
    assert look_of(surface(), PictureOptions()).background == 0.5


def test_every_format_comes_in_and_goes_out_and_what_the_file_says_is_kept(capsys, tmp_path):
    said = Drawing(antialiased=True, near_clip=0.05, up="z")
    write_model(tmp_path / "m.ply", Model(surface(), said))
    for source, out in (("m.ply", "a.spz"), ("a.spz", "b.sog"), ("b.sog", "c.ply"), ("m.ply", "d.ply")):
        flags = ["--target", "50%" if source != "m.ply" else "400", "--steps", "2", *FLAGS]
        status, *_ = run(capsys, "simplify", tmp_path / source, "-o", tmp_path / out, *flags)
        assert status == 0
    assert [read_model(tmp_path / name).splats.n_splats for name in ("a.spz", "b.sog", "c.ply")] == [400, 200, 100]
    assert read_model(tmp_path / "a.spz").drawing.antialiased and read_model(tmp_path / "d.ply").drawing == said
