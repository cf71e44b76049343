"""``dogsplat masks``: what stands in one photograph is masked there, and nothing else is."""

import json

import numpy as np
import pytest
import tiny_data
from command_line import run
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.datasets.masks import Masks
from mi_dogsplat.masking import make
from mi_dogsplat.masking.make import make_masks
from mi_dogsplat.render.mask_sheet import TINT
from mi_dogsplat.render.picture_options import PictureOptions
from mi_dogsplat.scene.ply import write_ply
from mi_dogsplat.support.pictures import write_png
from PIL import Image

N = 24
STANDS = {"4": (slice(8, 20), slice(10, 26)), "13": (slice(16, 30), slice(24, 40))}  # rows and columns, by view
DARKER = "9"
TEST = ("0", "16", "23")  # every eighth of the names, in their order


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A folder with ``data``, whose photographs are those of ``model.ply``, but that something yellow stands in two of
    them and in a test view, and that one is darker."""
    folder = tmp_path_factory.mktemp("moved")
    data = tiny_data.write_tiny_data(folder / "data", N)
    assert {view.name for view in load_dataset(data).test} == set(TEST)
    for name, place in {**STANDS, "16": (slice(8, 20), slice(10, 26))}.items():
        pixels = read_image(data / "images" / f"{name}.png").copy()
        pixels[place] = (0.9, 0.8, 0.1)
        write_png(data / "images" / f"{name}.png", pixels)
    write_png(data / "images" / f"{DARKER}.png", 0.6 * read_image(data / "images" / f"{DARKER}.png"))
    write_ply(folder / "model.ply", tiny_data.truth())
    return folder


def masked_in(folder, name: str) -> np.ndarray:
    """[H, W] bool."""
    with Image.open(folder / f"{name}.png") as image:
        assert image.mode == "L"
        return np.asarray(image) < 128


def test_what_stands_in_single_photographs_is_masked_there_alone(capsys, scene, tmp_path):
    out, preview = tmp_path / "new" / "masks", tmp_path / "sheet.png"
    status, said, _ = run(capsys, "masks", scene / "model.ply", scene / "data", "-o", out, "--preview", preview)
    assert status == 0
    assert {path.stem for path in out.iterdir()} == {str(k) for k in range(N)}
    for k in range(N):
        found, expected = masked_in(out, str(k)), np.zeros((36, 48), bool)
        if str(k) in STANDS:
            expected[STANDS[str(k)]] = True
            assert found[expected].mean() > 0.98
            rows, columns = STANDS[str(k)]
            near = np.zeros_like(found)
            near[rows.start - 4 : rows.stop + 4, columns.start - 4 : columns.stop + 4] = True
            assert not found[~near].any()
        else:
            assert not found.any()
    assert "in 2 of 21 photographs; the most in 13 (" in said and "poses" not in said
    with Image.open(preview) as image:
        assert image.size[0] == 2 * 240  # of two photographs
        pixels = np.asarray(image)[..., :3] / 255.0
    name, (rows, columns) = "13", STANDS["13"]  # first on the sheet, five times as large
    truth = read_image(scene / "data" / "images" / f"{name}.png")
    at, beside = (rows.start + 6, columns.start + 8), (4, 4)
    np.testing.assert_allclose(pixels[5 * at[0], 5 * at[1]], (truth[at] + TINT) / 2, atol=0.02)
    np.testing.assert_allclose(pixels[5 * beside[0], 5 * beside[1]], truth[beside], atol=0.02)


def test_the_masks_can_be_trained_with(scene, tmp_path):
    make_masks(scene / "model.ply", scene / "data", tmp_path / "masks")
    views = load_dataset(scene / "data").train
    masks = Masks(tmp_path / "masks", views)
    for view in views:
        mask = masks.of(view)
        assert mask is not None and (mask == 0).any() == (view.name in STANDS)


def test_a_capture_in_which_nothing_moved(capsys, tmp_path):
    data = tiny_data.write_tiny_data(tmp_path / "data")
    write_ply(tmp_path / "model.ply", tiny_data.truth())
    status, said, _ = run(capsys, "masks", tmp_path / "model.ply", data, "-o", tmp_path / "masks")
    assert status == 0 and said.endswith("masks: nothing is masked in any of 7 photographs\n")
    assert not any(masked_in(tmp_path / "masks", path.stem).any() for path in (tmp_path / "masks").iterdir())


def test_masks_that_there_are_stay_and_say_nothing(scene, tmp_path):
    """One hides what stands in view 4, another the left half of view 5, in which a thing stands at the right."""
    given, data = tmp_path / "given", tmp_path / "data"
    tiny_data.write_tiny_data(data, N)
    white = np.ones((36, 48, 3))
    for name, place in {"4": STANDS["4"], "5": (slice(None), slice(24)), "16": STANDS["4"]}.items():
        mask = white.copy()
        mask[place] = 0
        write_png(given / f"{name}.png", mask)
    for name, place in {"4": STANDS["4"], "5": (slice(10, 24), slice(30, 44))}.items():
        pixels = read_image(data / "images" / f"{name}.png").copy()
        pixels[place] = (0.9, 0.8, 0.1)
        write_png(data / "images" / f"{name}.png", pixels)
    config = make.MasksConfig(masks=str(given))
    found = make_masks(scene / "model.ply", data, tmp_path / "masks", config)
    np.testing.assert_array_equal(masked_in(tmp_path / "masks", "4"), read_image(given / "4.png")[..., 0] == 0)
    both = masked_in(tmp_path / "masks", "5")
    assert both[:, :24].all() and both[10:24, 30:44].mean() > 0.98 and not both[28:, 26:].any()
    assert set(found.masked) == {"4", "5"}
    of_test_view = masked_in(tmp_path / "masks", "16")
    assert of_test_view[STANDS["4"]].all() and of_test_view.sum() == of_test_view[STANDS["4"]].size


def test_a_photograph_of_something_else_is_told(capsys, scene, tmp_path):
    """As one whose pose is wrong."""
    data = tiny_data.write_tiny_data(tmp_path / "data", N)
    pixels = read_image(data / "images" / "7.png")[::-1, ::-1]
    write_png(data / "images" / "7.png", 1 - pixels)
    status, said, _ = run(capsys, "masks", scene / "model.ply", data, "-o", tmp_path / "masks")
    assert status == 0 and "more than half of 1 photograph is masked, such as 7; poses may be wrong\n" in said


def test_a_higher_threshold_masks_less(scene, tmp_path):
    shares = []
    for times in (2.5, 5, 100):
        found = make_masks(scene / "model.ply", scene / "data", tmp_path / f"{times}", make.MasksConfig(times=times))
        shares.append(sum(found.shares.values()))
    assert shares[0] >= shares[1] > shares[2] == 0


def test_what_is_wrong_is_told_before_the_work(capsys, scene, tmp_path):
    full = tmp_path / "full"
    full.mkdir()
    (full / "a.txt").write_text("mine")
    model, data = scene / "model.ply", scene / "data"
    for arguments, line in [
        ([model, data, "-o", full], f"{full}: exists, and is not an empty folder; remove it, or name another folder"),
        ([model, data, "-o", full / "a.txt"], "exists, and is not an empty folder"),
        ([model, data, "-o", tmp_path / "m", "--preview", "a.jpg"], "a.jpg: no known picture format"),
        ([model, data, "-o", tmp_path / "m", "--times", "0.5"], "--times"),
        ([model, data, "-o", tmp_path / "m", "--masks", tmp_path / "none"], "none: no such folder"),
        ([tmp_path / "no.ply", data, "-o", tmp_path / "m"], "no.ply"),
        ([model, tmp_path / "none", "-o", tmp_path / "m"], "none: no such file or folder"),
    ]:
        status, _, error = run(capsys, "masks", *arguments)
        assert status == 2 and line in error and error.count("\n") == 1, error
    assert (full / "a.txt").read_text() == "mine" and not (tmp_path / "m").exists()


def test_what_is_stopped_leaves_nothing(scene, tmp_path, monkeypatch):
    calls = []

    def stop(found, view):
        calls.append(view)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return np.zeros((36, 48), bool)

    monkeypatch.setattr(make, "on_photograph", stop)
    with pytest.raises(KeyboardInterrupt):
        make_masks(scene / "model.ply", scene / "data", tmp_path / "masks")
    assert not list(tmp_path.iterdir())


def test_an_empty_folder_may_be_named(scene, tmp_path):
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks" / ".DS_Store").write_text("left by a file manager")
    make_masks(scene / "model.ply", scene / "data", tmp_path / "masks")
    assert len(list((tmp_path / "masks").iterdir())) == N


def test_progress_counts_each_photograph_in_each_round(scene, tmp_path):
    seen = []
    make_masks(scene / "model.ply", scene / "data", tmp_path / "masks", show=lambda done, n: seen.append((done, n)))
    assert seen == [(k + 1, 42) for k in range(42)]


def test_photographs_of_radiance_are_compared_in_their_exposure(tmp_path):
    """OpenEXR, twice as bright as a screen shows, with a lamp that stands in one view."""
    data = tiny_data.write_tiny_data(tmp_path / "data")
    content = json.loads((data / "transforms.json").read_text())
    for frame in content["frames"]:
        frame["file_path"] = frame["file_path"].replace(".png", ".exr")
    (data / "transforms.json").write_text(json.dumps(content))
    from mi_dogsplat.render.picture import light_of
    from mi_dogsplat.support.pictures import write_radiance

    for k, camera in enumerate(tiny_data.cameras()):
        light = light_of(tiny_data.picture(tiny_data.truth(), camera)).astype(np.float32)
        if k == 3:
            light[8:20, 10:26] = 5
        write_radiance(data / "images" / f"{k}.exr", light)
    write_ply(tmp_path / "model.ply", tiny_data.truth())
    found = make_masks(tmp_path / "model.ply", data, tmp_path / "masks")
    assert set(found.masked) == {"3"} and masked_in(tmp_path / "masks", "3")[8:20, 10:26].mean() > 0.98
    dark = PictureOptions(white=1e6, linear=True)  # in which nobody sees a lamp
    assert not make_masks(tmp_path / "model.ply", data, tmp_path / "dark", options=dark).masked


def test_transparent_photographs_are_compared_over_what_is_behind_them(tmp_path):
    """Over white something black shows where there was nothing, and over black something white does."""
    data = tiny_data.write_tiny_data(tmp_path / "data", alpha=True)
    write_ply(tmp_path / "model.ply", tiny_data.truth())
    for name, color in (("2", 0.0), ("5", 1.0)):
        with Image.open(data / "images" / f"{name}.png") as image:
            pixels = np.asarray(image) / 255.0
        pixels[:8, :10] = (color, color, color, 1)
        write_png(data / "images" / f"{name}.png", pixels)
    for background, name in ((None, "2"), ("white", "2"), ("black", "5")):
        options = PictureOptions(background=background)
        found = make_masks(tmp_path / "model.ply", data, tmp_path / f"{background}", options=options)
        assert set(found.masked) == {name} and masked_in(tmp_path / f"{background}", name)[:8, :10].mean() > 0.98


def test_shrunk_photographs_have_small_masks_and_options_say_how_the_model_is_drawn(scene, tmp_path):
    found = make_masks(scene / "model.ply", scene / "data", tmp_path / "half", options=PictureOptions(downscale=2))
    assert set(found.masked) == set(STANDS) and masked_in(tmp_path / "half", "4").shape == (18, 24)
    hidden = make_masks(scene / "model.ply", scene / "data", tmp_path / "hidden", options=PictureOptions(near_clip=50))
    assert set(hidden.masked) != set(STANDS)


def test_masks_that_there_are_keep_their_pixels_where_they_are_looked_for_in_smaller_ones(scene, tmp_path, monkeypatch):
    """A chessboard, painted on photographs four times as large as what is searched, through a lens."""
    monkeypatch.setattr(make, "LONGEST", 12)
    data = tiny_data.write_tiny_data(tmp_path / "data", N)
    content = json.loads((data / "transforms.json").read_text()) | {"k1": -0.1}
    (data / "transforms.json").write_text(json.dumps(content))
    board = (np.indices((36, 48)).sum(0) % 2).astype(float)
    write_png(tmp_path / "given" / "5.png", board)
    config = make.MasksConfig(masks=str(tmp_path / "given"), times=100)
    make_masks(scene / "model.ply", data, tmp_path / "masks", config)
    np.testing.assert_array_equal(masked_in(tmp_path / "masks", "5"), board == 0)
