"""``dogsplat clean``: what leaves is what was asked for, the rest keeps its bits, and bad input is one line."""

from pathlib import Path

import numpy as np
import pytest
import tiny_data
from command_line import assert_one_line, run
from mi_dogsplat import read_ply, write_ply
from mi_dogsplat.cli.printing import cleaned_lines
from mi_dogsplat.datasets import View, load_dataset
from mi_dogsplat.editing.clean import Cleaned, clean_model
from mi_dogsplat.editing.clean_config import CleanConfig
from mi_dogsplat.editing.regions import in_box, largest_parts
from mi_dogsplat.editing.views import evidence, seen
from mi_dogsplat.formats.model import Model
from mi_dogsplat.formats.read import read_model
from mi_dogsplat.formats.write import write_model
from mi_dogsplat.scene.drawing import Drawing, DrawnAs
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.wording import file_size
from own_axes_models import CURVED, CUT, SECOND_CUT, SHIFTED, SLOPED, Kind
from PIL import Image


def wasteful() -> Splats:
    model = tiny_data.dog_model()
    model.logit_opacities[:6] = -9
    model.dog_logit_opacities[10:14] = -40
    model.sh_coeffs[:, 1:] = 0
    return model


@pytest.fixture
def model(tmp_path):
    write_ply(tmp_path / "model.ply", wasteful())
    return tmp_path / "model.ply"


def test_without_flags_all_views_keep_their_bits(capsys, model, tmp_path):
    status, printed, _ = run(capsys, "clean", model, "-o", tmp_path / "lean.ply")
    lines = printed.splitlines()
    assert status == 0 and lines[0] == "60 primitives, removed:"
    assert lines[1].startswith("  not needed, invisible primitives: 6, ")
    assert lines[2].startswith("  not needed, DoG without effect: 4, ")
    assert lines[3].startswith("  not needed, zero bands of SH degree 1: 54, ")
    sizes = [file_size(path.stat().st_size) for path in (tmp_path / "lean.ply", model)]
    assert lines[4] == f"{tmp_path / 'lean.ply'}: 54 primitives, {sizes[0]}; model.ply has {sizes[1]}"
    assert "kB" in sizes[0]
    before, after = read_ply(model), read_ply(tmp_path / "lean.ply")
    assert after.sh_degree == 0 and after.n_dog == before.n_dog - 3 - 4
    for camera in tiny_data.cameras():
        pictures = [tiny_data.picture(s, camera) if s.sh_degree else bare(s, camera) for s in (before, after)]
        assert np.array_equal(pictures[0].color, pictures[1].color)


def bare(splats, camera):
    from mi_dogsplat.render.picture import picture_of

    return picture_of(splats, 0.0)(camera)


def test_a_clean_model_stays_as_it_is(capsys, tmp_path):
    write_ply(tmp_path / "m.ply", tiny_data.dog_model())
    status, printed, _ = run(capsys, "clean", tmp_path / "m.ply", "-o", tmp_path / "same.ply")
    assert status == 0 and printed.startswith("60 primitives, removed: nothing\n")
    assert (tmp_path / "same.ply").read_bytes() == (tmp_path / "m.ply").read_bytes()


def test_nothing_is_said_to_leave_also_where_photographs_are_looked_at():
    lines = cleaned_lines(Cleaned(60, 60, [], [], (20.0, 20.0), []))
    assert lines == ["60 primitives, removed: nothing", "  PSNR 20.00 dB before, 20.00 dB after (+0.00)"]


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".spz"])
@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (SLOPED, ("cannot hold colours that vary over a primitive", "slopes that are zero: 1, 40 bytes")),
        (CURVED, ("cannot hold colours that vary over a primitive", "curvatures that are zero: 1, 28 bytes")),
        (CUT, ("cannot hold cuts", "cuts that are zero: 1, 16 bytes")),
        (SECOND_CUT, ("cannot hold cuts", "second cuts that are zero: 1, 16 bytes")),
        (SHIFTED, ("cannot hold places that depend on the view", "shifts that are zero: 1, 52 bytes")),
    ],
    ids=["slopes", "curvatures", "cuts", "second_cuts", "shifts"],
)
def test_rows_stay_with_their_primitives_or_a_line_says_that_they_do_not(capsys, tmp_path, suffix, kind: Kind, said):
    (lost, unneeded), splats = said, kind.having(tiny_data.truth(), every=3)
    box = (-1, -1, -1), (0, 1, 1)
    kept = in_box(splats, *box)
    kind.values(splats)[np.flatnonzero(kept[::3])[1]] = 0
    write_ply(tmp_path / "m.ply", splats)
    out = tmp_path / f"o{suffix}"
    status, printed, _ = run(capsys, "clean", tmp_path / "m.ply", "-o", out, "--box", *box[0], *box[1])
    assert status == 0 and (lost in printed) == (suffix == ".spz")
    assert f"not needed, {unneeded}" in printed
    expected = splats.select(kept)
    rows = kind.values(expected).reshape(kind.n(expected), -1).any(axis=1)
    found = read_model(out).splats
    assert kind.n(found) == (0 if suffix == ".spz" else rows.sum()) and 2 < rows.sum() < 19
    if suffix == ".ply":
        np.testing.assert_array_equal(kind.index(found), kind.index(expected)[rows])
        np.testing.assert_array_equal(kind.values(found), kind.values(expected)[rows])


def test_each_rule_takes_out_what_it_says(model, tmp_path):
    splats, out = wasteful(), tmp_path / "o.ply"

    def left(**flags) -> np.ndarray:
        clean_model(model, out, CleanConfig(**flags))
        return read_ply(out).means

    visible = splats.opacities > 0.1
    radius = np.linalg.norm(splats.means - (0.1, 0, 0), axis=1)
    expected = {
        "box": ({"box": (-0.5, -0.5, -1, 0.2, 0.5, 1)}, in_box(splats, (-0.5, -0.5, -1), (0.2, 0.5, 1))),
        "sphere": ({"sphere": (0.1, 0, 0, 0.5)}, radius <= 0.5),
        "opacity": ({"min_opacity": 0.8}, splats.opacities >= 0.8),
        "scale": ({"max_scale": 0.15}, splats.scales.max(axis=1) <= 0.15),
        "both": ({"min_opacity": 0.8, "max_scale": 0.15}, (splats.opacities >= 0.8) & (splats.scales.max(1) <= 0.15)),
    }
    for name, (flags, keep) in expected.items():
        assert 0 < keep.sum() < 60, name
        assert np.array_equal(left(**flags), splats.means[keep & visible]), name


def test_parts_are_looked_for_in_what_the_crop_leaves(model, tmp_path):
    splats = wasteful()
    keep = in_box(splats, (-1, -1, -1), (0.0, 1, 1))
    part = largest_parts(splats.select(keep), 1)
    clean_model(model, tmp_path / "o.ply", CleanConfig(box=(-1, -1, -1, 0, 1, 1), connected=1))
    found = read_ply(tmp_path / "o.ply")
    kept = splats.select(keep).select(part)
    assert np.array_equal(found.means, kept.means[kept.opacities > 0.1])


def test_the_training_views_say_what_is_seen_and_what_floats(capsys, data, tmp_path):
    splats = tiny_data.truth()
    splats.means[:5] += (0, 0, 50)
    write_ply(tmp_path / "m.ply", splats)
    flags = ["--data", data, "--seen", "--floaters", "--preview", tmp_path / "p.png"]
    status, printed, _ = run(capsys, "clean", tmp_path / "m.ply", "-o", tmp_path / "o.ply", *flags)
    cameras = tiny_data.cameras()[1:]  # the first is for testing
    stays = seen(splats, cameras, DrawnAs()) & ~evidence(splats, cameras, DrawnAs()).floats
    assert status == 0 and "  never seen: 5\n" in printed and "PSNR" in printed
    assert np.array_equal(read_ply(tmp_path / "o.ply").means, splats.means[stays])
    with Image.open(tmp_path / "p.png") as preview:
        assert preview.size == (2 * tiny_data.WIDTH, tiny_data.HEIGHT)


def test_masks_lead_to_the_object_that_they_show(capsys, data, tmp_path):
    """Two heaps of small splats: masks of the left one, drawn by hand around its projected centres, keep it alone."""
    splats = tiny_data.truth().plain()
    left = np.arange(splats.n_splats) % 2 == 0
    splats.means[:] = np.where(left[:, None], -0.5, 0.5) * (1, 0, 0) + 0.1 * splats.means
    splats.means[4] += (0, 0, 50)  # of the left ones, and never seen
    splats.log_scales[:] = np.log(0.03)
    write_ply(tmp_path / "m.ply", splats)
    (tmp_path / "masks").mkdir()
    views = load_dataset(data).train
    for view in views[:-1]:  # the last has none, and is not asked
        mask = np.zeros((view.camera.height, view.camera.width), np.uint8)
        for u, v in view.camera.project(splats.means[left])[0].astype(int):
            mask[max(v - 4, 0) : v + 5, max(u - 4, 0) : u + 5] = 255
        Image.fromarray(mask).save(tmp_path / "masks" / f"{view.name}.png")
    flags = ["--data", data, "--masks", tmp_path / "masks"]
    status, printed, _ = run(capsys, "clean", tmp_path / "m.ply", "-o", tmp_path / "o.ply", *flags)
    expected = left & (np.arange(splats.n_splats) != 4)
    assert status == 0 and f"outside of the masks: {(~expected).sum()}\n" in printed
    assert np.array_equal(read_ply(tmp_path / "o.ply").means, splats.means[expected])


def write_masks(folder: Path, views: list[View], white_columns: int) -> Path:
    """Masks that are white on the left, ``white_columns`` wide."""
    folder.mkdir()
    for view in views:
        mask = np.zeros((view.camera.height, view.camera.width), np.uint8)
        mask[:, :white_columns] = 255
        Image.fromarray(mask).save(folder / f"{view.name}.png")
    return folder


@pytest.mark.parametrize("masked", [False, True])
def test_psnr_is_that_of_eval(capsys, data, model, tmp_path, masked):
    masks = ["--masks", write_masks(tmp_path / "masks", load_dataset(data).views, 20)] if masked else []
    flags = ["--data", data, "--max-scale", "0.15", *masks]
    _, printed, _ = run(capsys, "clean", model, "-o", tmp_path / "o.ply", *flags)
    for path, word in ((model, "before"), (tmp_path / "o.ply", "after")):
        _, measured, _ = run(capsys, "eval", path, data, *masks)
        assert measured.splitlines()[-1].split("PSNR ")[1].split("  ")[0] + f" {word}" in printed


def test_where_masks_leave_nothing_of_the_views_that_are_measured_no_psnr_is_printed(capsys, data, model, tmp_path):
    dataset = load_dataset(data)
    masks = write_masks(tmp_path / "masks", dataset.train, 40)
    for path in write_masks(tmp_path / "black", dataset.test, 0).iterdir():
        path.rename(masks / path.name)
    flags = ["--data", data, "--masks", masks]
    status, printed, _ = run(capsys, "clean", model, "-o", tmp_path / "o.ply", *flags)
    assert status == 0 and "outside of the masks" in printed and "PSNR" not in printed


def test_a_preview_shows_before_and_after_from_one_camera(capsys, model, tmp_path):
    run(capsys, "clean", model, "-o", tmp_path / "o.ply", "--sphere", 0, 0, 0, 0.4, "--preview", tmp_path / "p.png")
    picture = np.asarray(Image.open(tmp_path / "p.png"), int)
    assert picture.shape == (600, 1600, 3)
    before, after = picture[:, :800], picture[:, 800:]
    assert (before.max(2) > 30).sum() > 1.5 * (after.max(2) > 30).sum() > 0


@pytest.mark.parametrize("preview, problem", [("none/p.png", "no such folder"), ("folder.png", "is a folder")])
def test_a_preview_that_cannot_be_written_is_told_before_the_model_is(capsys, model, tmp_path, preview, problem):
    (tmp_path / "folder.png").mkdir()
    command = ["clean", model, "-o", tmp_path / "o.ply", "--preview", tmp_path / preview]
    assert_one_line(run(capsys, *command), preview, problem)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder.png", "model.ply"]


@pytest.mark.parametrize(
    "flags, words",
    [
        (["--box", 0, 0, 0, 1, -1, 1], ["--box", "0 0 0 1 -1 1", "inverted along y", "lowest corner first"]),
        (["--box", 0, 0, 0, 1, "nan", 1], ["--box", "nan", "finite"]),
        (["--box", 0, 0, 0], ["--box"]),
        (["--sphere", 0, 0, 0, 0], ["--sphere", "radius of 0", "above 0"]),
        (["--sphere", 0, 0, "inf", 1], ["--sphere", "finite"]),
        (["--min-opacity", 2], ["--min-opacity", "0 to 1"]),
        (["--max-scale", 0], ["--max-scale"]),
        (["--connected", 0], ["--connected", "at least 1"]),
        (["--seen"], ["--seen", "add --data DATA"]),
        (["--floaters"], ["--floaters", "add --data DATA"]),
        (["--masks", "masks"], ["--masks", "add --data DATA"]),
        (["--preview", "p.jpg"], ["p.jpg", ".png"]),
        (["--downscale", 2], ["--downscale", "no images"]),
        (["--background", "white"], ["--background", "no picture"]),
        (["--box", 7, 7, 7, 8, 8, 8], ["model.ply", "no primitive would be left", "remove less"]),
    ],
    ids=lambda value: " ".join(map(str, value)) if str(value[0])[:2] == "--" else "",
)
def test_wrong_use_is_one_line_and_writes_nothing(capsys, model, tmp_path, flags, words):
    assert_one_line(run(capsys, "clean", model, "-o", tmp_path / "o.ply", *flags), *words)
    assert not (tmp_path / "o.ply").exists()


def test_files_that_cannot_be_cleaned_are_one_line(capsys, model, tmp_path):
    out = tmp_path / "o.ply"
    assert_one_line(run(capsys, "clean", tmp_path / "none.ply", "-o", out), "none.ply")
    assert_one_line(run(capsys, "clean", model, "-o", model), "model.ply", "would be lost")
    write_ply(tmp_path / "empty.ply", Splats.empty(0))
    assert_one_line(run(capsys, "clean", tmp_path / "empty.ply", "-o", out), "empty.ply", "the model is empty")
    with pytest.raises(DataError, match="would be lost"):
        clean_model(model, model)
    assert_one_line(run(capsys, "clean", model, "-o", tmp_path / "o.obj"), "o.obj")
    assert_one_line(run(capsys, "clean", model, "-o", tmp_path / "o.spz"), "o.spz", "cannot hold DoG")
    assert_one_line(run(capsys, "clean", model, "-o", tmp_path / "o.sog", "--mixed-sh"), "--mixed-sh", ".ply")


def file_with_nan(folder: Path, suffix: str) -> Path:
    """The model with a NaN in the centre of primitive 3, and in PLY in the slopes of primitive 20, too."""
    model = tiny_data.truth()
    if suffix == ".ply":
        model = SLOPED.having(model, every=20)
        SLOPED.values(model)[:] = 0.125
    path = folder / f"broken{suffix}"
    write_model(path, model)
    data, nan = path.read_bytes(), np.float32(np.nan).tobytes()
    z = model.means[3, 2].tobytes()  # which has its sign in glTF, too
    assert data.count(z) == 1
    data = data.replace(z, nan)
    if suffix == ".ply":
        row = np.uint32(20).tobytes() + np.float32(0.125).tobytes()
        assert data.count(row) == 1
        data = data.replace(row, row[:4] + nan)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".splat"])
def test_primitives_that_are_not_finite_are_taken_out_which_no_other_command_reads(capsys, tmp_path, suffix):
    path, broken = file_with_nan(tmp_path, suffix), [3, 20] if suffix == ".ply" else [3]
    told = run(capsys, "export", path, "-o", tmp_path / "out.spz")
    assert_one_line(told, f"broken{suffix}", "not finite", "remove those primitives with dogsplat clean")
    flags = ["--connected", 1, "--preview", tmp_path / "p.png"]
    status, printed, _ = run(capsys, "clean", path, "-o", tmp_path / "out.ply", *flags)
    assert status == 0 and printed.splitlines()[:2] == [
        f"{tiny_data.N_TRUTH} primitives, removed:", f"  not finite: {len(broken)}"
    ]
    left = {tuple(mean) for mean in read_ply(tmp_path / "out.ply").means}
    good = np.delete(tiny_data.truth().means, broken, axis=0)
    assert left <= {tuple(mean) for mean in good}


def test_a_model_without_a_primitive_that_is_finite_is_refused(capsys, tmp_path):
    (tmp_path / "a.splat").write_bytes(np.full(8, np.nan, "<f4").tobytes())
    assert_one_line(run(capsys, "clean", tmp_path / "a.splat", "-o", tmp_path / "o.ply"), "a.splat", "all finite")


def test_degrees_of_single_primitives_are_kept_or_made(capsys, tmp_path):
    splats = tiny_data.truth()
    splats.sh_coeffs[::3, 1:] = 0
    write_ply(tmp_path / "m.ply", splats)
    run(capsys, "clean", tmp_path / "m.ply", "-o", tmp_path / "rows.ply", "--mixed-sh")
    run(capsys, "clean", tmp_path / "rows.ply", "-o", tmp_path / "again.ply")
    run(capsys, "clean", tmp_path / "rows.ply", "-o", tmp_path / "m.spz")
    for name in ("rows.ply", "again.ply"):
        found = read_ply(tmp_path / name)
        assert found.sh_degrees.tolist() == [0, 1, 1] * 20
        assert np.array_equal(found.uniform_sh().sh_coeffs, splats.sh_coeffs)
    assert read_model(tmp_path / "m.spz").splats.sh_degrees.tolist() == [1] * 60


def test_degrees_of_single_primitives_are_not_made_where_they_would_make_the_file_larger(capsys, tmp_path):
    splats = tiny_data.truth()
    splats.sh_coeffs[:2, 1:] = 0  # 72 bytes, where 58 primitives would have an index
    write_ply(tmp_path / "m.ply", splats)
    flags = ["-o", tmp_path / "o.ply", "--mixed-sh"]
    assert "--mixed-sh:" not in run(capsys, "clean", tmp_path / "m.ply", "-o", tmp_path / "plain.ply")[1]
    status, printed, _ = run(capsys, "clean", tmp_path / "m.ply", *flags)
    assert status == 0 and "removed: nothing" in printed and "--mixed-sh: an SH degree for each" in printed
    assert (tmp_path / "o.ply").read_bytes() == (tmp_path / "m.ply").read_bytes()
    write_ply(tmp_path / "m.ply", tiny_data.truth())
    assert "mixed" not in run(capsys, "clean", tmp_path / "m.ply", *flags)[1]


def test_what_the_file_says_is_kept_and_flags_come_first(capsys, tmp_path):
    write_model(tmp_path / "m.ply", Model(tiny_data.truth(), Drawing(antialiased=True, up="z")))
    run(capsys, "clean", tmp_path / "m.ply", "-o", tmp_path / "o.ply", "--near-clip", "0.3")
    assert read_model(tmp_path / "o.ply").drawing == Drawing(antialiased=True, near_clip=0.3, up="z")
