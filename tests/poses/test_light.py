"""Raw photographs and OpenEXR become one light for all images, and what a screen shows of it."""

import json
from pathlib import Path

import numpy as np
import pytest
from apple_notes import apple_note
from dng_files import RATIONAL, SHORT, UNDEFINED, write_dng
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.exr import exr_saturation, read_exr
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.poses.config import PosesConfig
from mi_dogsplat.poses.light import prepare_light
from mi_dogsplat.poses.run import find_poses
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.pictures import write_radiance
from mi_dogsplat.support.srgb import displayed, luminance, srgb_to_linear
from posed_room import N

pytest.importorskip("rawpy", reason="needs rawpy: pip install 'mi_dogsplat[poses]'")
BLOCK = 16  # pixels of a side of one colour
NEUTRAL = (0.5, 1.0, 0.7)
FOCAL_35MM, MAKER_NOTE, F_NUMBER, ISO = 0xA405, 0x927C, 0x829D, 0x8827


def scene() -> np.ndarray:
    """Linear light [64, 96, 3] in blocks of random colours."""
    return np.kron(np.random.default_rng(0).uniform(0.02, 0.25, (4, 6, 3)), np.ones((BLOCK, BLOCK, 1)))


def inside(pixels: np.ndarray) -> np.ndarray:
    return pixels[BLOCK // 2 :: BLOCK, BLOCK // 2 :: BLOCK]


def prepared(folder: Path, out: Path, radiance: bool = True):
    sources = {path.name: path for path in sorted(folder.iterdir())}
    return prepare_light(sources, out / "shown", out / "images" if radiance else None, lambda done, n: None)


def lights(out: Path) -> dict[str, np.ndarray]:
    return {path.stem: inside(read_exr(path)) for path in sorted((out / "images").iterdir())}


def test_a_surface_has_one_light_however_long_the_shutter_was_open(tmp_path):
    """By time, ISO and aperture; the median exposure has a gain of 1."""
    (tmp_path / "in").mkdir()
    for k, exposure in enumerate([(0.01, 200, 1.0), (0.005, 100, 1.0), (0.02, 400, 2.0)]):
        write_dng(tmp_path / "in" / f"{k}.dng", scene(), NEUTRAL, exposure)
    prepared(tmp_path / "in", tmp_path)
    for name, light in lights(tmp_path).items():
        np.testing.assert_allclose(light, 2 * inside(scene()), rtol=0.01, err_msg=name)


def test_light_tells_from_which_value_on_the_sensor_was_full(tmp_path):
    """In the unit of the light, so that a short exposure tells what a long one cannot. OpenEXR is copied as it is."""
    (tmp_path / "in").mkdir()
    for k, time in enumerate((0.08, 0.02, 0.005)):
        write_dng(tmp_path / "in" / f"{k}.dng", scene(), NEUTRAL, (time, 100, 1.0))
    write_radiance(tmp_path / "in" / "3.exr", scene(), 7.0)
    prepared(tmp_path / "in", tmp_path)
    files = [tmp_path / "images" / f"{k}.exr" for k in range(4)]
    levels = [exr_saturation(file) for file in files]
    assert levels == pytest.approx([0.95 / 4, 0.95, 4 * 0.95, 7])
    truth = inside(read_exr(files[2]))
    for file, level in zip(files[:2], levels, strict=False):
        light = inside(read_exr(file))
        assert level is not None
        full = light.max(axis=2) >= level
        assert full.any() == (truth.max() >= level) and (truth[full].max(axis=1) > 0.99 * level).all()
        np.testing.assert_allclose(light[~full], truth[~full], rtol=0.02)
    assert inside(read_exr(files[0])).max() <= 0.25 < truth.max()  # of the longest exposure


def test_nothing_is_divided_out_where_a_file_does_not_say_its_exposure(tmp_path):
    (tmp_path / "in").mkdir()
    for k, exposure in enumerate([(0.01, 200, 1.0), None, (0.005, 100, 1.0)]):
        write_dng(tmp_path / "in" / f"{k}.dng", scene(), exposure=exposure)
    prepared(tmp_path / "in", tmp_path)
    for light, gain in zip(lights(tmp_path).values(), (2, 1, 0.5), strict=True):
        np.testing.assert_allclose(light, gain * inside(scene()), rtol=0.01)


@pytest.mark.parametrize("tag, kind", [(F_NUMBER, RATIONAL), (ISO, SHORT)])
def test_nothing_is_divided_out_where_one_file_lacks_the_aperture_or_iso_that_others_say(tmp_path, tag, kind):
    """As where a lens has lost its contact: it would be 16 times as dark as the others. Where all lack it, as with a
    lens that has none, times are divided out."""
    (tmp_path / "in").mkdir()
    for lacking, gains in ((1,), (1, 1, 1)), ((0, 1, 2), (1, 0.5, 1)):
        for k in range(3):
            unsaid = {tag: (kind, 0)} if k in lacking else None
            taken = (0.04 * (1 + k % 2), 400, 4.0)
            write_dng(tmp_path / "in" / f"{k}.dng", scene(), exposure=taken, exif=unsaid)
        prepared(tmp_path / "in", tmp_path / str(len(lacking)))
        for k, (light, gain) in enumerate(zip(lights(tmp_path / str(len(lacking))).values(), gains, strict=True)):
            np.testing.assert_allclose(light, gain * (1 + k % 2) * inside(scene()), rtol=0.01)


def test_photographs_of_a_device_share_the_median_of_its_white_balances(tmp_path):
    (tmp_path / "in").mkdir()
    for k, neutral in enumerate([(0.5, 1, 0.7), (0.4, 1, 0.8), (0.6, 1, 0.5)]):
        write_dng(tmp_path / "in" / f"a{k}.dng", scene(), neutral)
    write_dng(tmp_path / "in" / "b.dng", scene(), (0.9, 1, 0.3), device=("Another", "one"))
    prepared(tmp_path / "in", tmp_path)
    found = lights(tmp_path)
    np.testing.assert_allclose(found["a0"], inside(scene()), rtol=0.01)
    np.testing.assert_allclose(found["b"], inside(scene()), rtol=0.01)
    # a sensor that sees less red in white is given no more red than the others
    of_white = {"a1": (0.4 / 0.5, 1, 0.8 / 0.7), "a2": (0.6 / 0.5, 1, 0.5 / 0.7)}
    for name, (red, green, blue) in of_white.items():
        grey = (found[name] / inside(scene())).mean(axis=(0, 1))
        assert grey[0] / grey[1] == pytest.approx(red / green, rel=0.1), name
        assert grey[2] / grey[1] == pytest.approx(blue / green, rel=0.1), name


def test_a_screen_shows_it_in_one_brightness_for_all(tmp_path):
    """With the white that a training on radiance would choose: twice the 95th percentile of the luminances."""
    (tmp_path / "in").mkdir()
    write_dng(tmp_path / "in" / "bright.dng", scene())
    write_dng(tmp_path / "in" / "dark.dng", scene() / 8)
    prepared(tmp_path / "in", tmp_path, radiance=False)
    assert not (tmp_path / "images").exists()
    white = 2 * np.percentile(luminance(np.stack([scene(), scene() / 8])), 95)
    for name, light in (("bright", scene()), ("dark", scene() / 8)):
        found = inside(read_image(tmp_path / "shown" / f"{name}.jpg"))
        np.testing.assert_allclose(found, displayed(inside(light), white), atol=0.03)


def test_photographs_are_named_and_told_apart_as_others_are(tmp_path):
    (tmp_path / "in").mkdir()
    held = {FOCAL_35MM: (SHORT, 26), MAKER_NOTE: (UNDEFINED, apple_note((0, -1, 0)))}
    write_dng(tmp_path / "in" / "IMG 1.DNG", scene(), orientation=6, device=("Apple", "iPhone"), exif=held)
    write_dng(tmp_path / "in" / "b.dng", scene())
    upright, plain = prepared(tmp_path / "in", tmp_path)
    assert (upright.name, upright.width, upright.height) == ("IMG_1.jpg", 64, 96)
    assert upright.camera == "Apple iPhone 26 64x96" and plain.camera == "Maker Model 96x64"
    assert upright.focal == pytest.approx(26 / np.hypot(36, 24) * np.hypot(64, 96)) and plain.focal is None
    assert upright.turn is None and upright.down == pytest.approx((0, 1, 0), abs=1e-9) and plain.down is None
    assert read_exr(tmp_path / "images" / "IMG_1.exr").shape == (96, 64, 3)


def test_a_second_start_makes_only_what_is_missing(tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("a.dng", "b.dng"):
        write_dng(tmp_path / "in" / name, scene())
    first = prepared(tmp_path / "in", tmp_path)
    files = [tmp_path / name for name in ("shown/a.jpg", "shown/b.jpg", "images/a.exr", "images/b.exr")]
    before = [file.stat().st_ino for file in files]
    data = files[3].read_bytes()
    assert prepared(tmp_path / "in", tmp_path) == first and [file.stat().st_ino for file in files] == before
    files[3].unlink()
    assert prepared(tmp_path / "in", tmp_path) == first and files[3].read_bytes() == data
    assert [file.stat().st_ino for file in files[::2]] == before[::2]


def test_openexr_is_copied_and_what_is_transparent_stays_it(tmp_path):
    (tmp_path / "in").mkdir()
    alpha = np.zeros((64, 96, 1))
    alpha[:, 48:] = 0.5
    write_radiance(tmp_path / "in" / "a.EXR", np.concatenate([scene() * alpha, alpha], axis=2))
    write_radiance(tmp_path / "in" / "b.exr", 2 * scene())
    clear, opaque = prepared(tmp_path / "in", tmp_path)
    assert (clear.name, opaque.name, clear.camera, clear.focal) == ("a.png", "b.jpg", "96x64", None)
    for name, copy in (("a.EXR", "a.exr"), ("b.exr", "b.exr")):
        assert (tmp_path / "images" / copy).read_bytes() == (tmp_path / "in" / name).read_bytes()
    shown, whole = read_image(tmp_path / "shown" / "a.png"), read_image(tmp_path / "shown" / "b.jpg")
    np.testing.assert_allclose(shown[..., 3:], alpha, atol=0.005)
    white = 2 * np.percentile(luminance(np.concatenate([scene()[:, 48:] * 0.5, 2 * scene()], axis=1)), 95)
    np.testing.assert_allclose(inside(shown[:, 48:, :3]), inside(displayed(scene()[:, 48:], white)) * 0.5, atol=0.03)
    np.testing.assert_allclose(inside(whole), inside(displayed(2 * scene(), white)), atol=0.03)


def test_two_of_one_name_and_what_cannot_be_read_are_errors(tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("a.dng", "a.nef"):
        write_dng(tmp_path / "in" / name, scene())
    with pytest.raises(DataError, match='two views have the name "a"'):
        prepared(tmp_path / "in", tmp_path)
    (tmp_path / "in" / "a.nef").write_bytes(b"no picture")
    (tmp_path / "in" / "a.nef").rename(tmp_path / "in" / "b.nef")
    with pytest.raises(DataError, match="b.nef: cannot be read as a raw photograph"):
        prepared(tmp_path / "in", tmp_path)


@pytest.mark.slow
def test_raw_photographs_become_a_data_set_of_radiance_with_its_lens_and_without(tmp_path, pixels):
    """The room, as photographs whose exposures differ by two stops."""
    (tmp_path / "in").mkdir()
    seen = [0.4 * srgb_to_linear(p / np.float32(255)) for p in pixels]
    for k, light in enumerate(seen):
        write_dng(tmp_path / "in" / f"{k}.dng", light, NEUTRAL, exposure=(0.005 * 2 ** (k % 3), 100, 1.0))
    summary = find_poses(tmp_path / "in", tmp_path / "out", PosesConfig(linear=True, undistort=True))
    assert summary.n_registered == N
    for folder in (tmp_path / "out", tmp_path / "out" / "distorted"):
        dataset = load_dataset(folder)
        assert dataset.white is not None and len(dataset.views) == N and len(dataset.points) > 300
        means = [view.image[60:180, 80:240].mean() for view in dataset.views]
        truth = [seen[int(view.name)][60:180, 80:240].mean() for view in dataset.views]
        ratios = np.array(means) / truth
        np.testing.assert_allclose(ratios / ratios.mean(), 1, atol=0.05)


def test_openexr_stays_linear_unasked(tmp_path):
    """Of a grey wall, which gives no features: what was made until then is there."""
    (tmp_path / "in").mkdir()
    for name in ("a.exr", "b.exr"):
        write_radiance(tmp_path / "in" / name, np.full((64, 96, 3), 0.3))
    with pytest.raises(DataError, match="no poses found"):
        find_poses(tmp_path / "in", tmp_path / "out", PosesConfig())
    assert json.loads((tmp_path / "out" / "poses.json").read_text())["linear"] is True
    assert sorted(path.name for path in (tmp_path / "out" / "images").iterdir()) == ["a.exr", "b.exr"]
    assert sorted(path.name for path in (tmp_path / "out" / "work" / "shown").iterdir()) == ["a.jpg", "b.jpg"]


def test_linear_is_refused_where_there_is_no_light_to_keep(tmp_path, room):
    with pytest.raises(DataError, match="--linear: is for photographs, and .*walk.mp4 is a video"):
        find_poses(room / "walk.mp4", tmp_path / "out", PosesConfig(linear=True))
    with pytest.raises(DataError, match="pictures: has no raw photographs and no OpenEXR"):
        find_poses(room / "pictures", tmp_path / "out", PosesConfig(linear=True))
    with pytest.raises(DataError, match="--linear: is not made of panoramas"):
        PosesConfig(linear=True, lens="EQUIRECTANGULAR")
    (tmp_path / "around").mkdir()
    for name in ("a.exr", "b.exr"):
        write_radiance(tmp_path / "around" / name, np.full((8, 16, 3), 0.3))
    with pytest.raises(DataError, match="around/a.exr: is OpenEXR, of which no panoramas are cut; export"):
        find_poses(tmp_path / "around", tmp_path / "out", PosesConfig(lens="EQUIRECTANGULAR"))
    assert not (tmp_path / "out").exists()
