"""Photographs that name another space than sRGB, by an ICC profile or else, are read as what they show."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from dataset_folders import colmap_folder
from icc_profiles import ADOBE_CURVE, ADOBE_RGB, DISPLAY_P3, SRGB, SRGB_CURVE, black_of_cmyk, grey, profile, srgb_of
from mi_dogsplat.datasets import check_cameras, load_dataset
from mi_dogsplat.datasets.images import read_image
from mi_dogsplat.support.errors import DataError
from PIL import ExifTags, Image, ImageCms

SPACES = {"Display P3": (DISPLAY_P3, SRGB_CURVE), "Adobe RGB": (ADOBE_RGB, ADOBE_CURVE)}


def written(file: Path, levels: np.ndarray, icc: bytes | None) -> Path:
    Image.fromarray(levels).save(file, icc_profile=icc)
    return file


@pytest.fixture
def levels() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (100, 64, 3), dtype=np.uint8)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("suffix", [".png", ".tif", ".webp"])
def test_colours_become_srgb(tmp_path, levels, space, suffix):
    icc = profile(*SPACES[space])
    file = tmp_path / f"a{suffix}"
    Image.fromarray(levels).save(file, icc_profile=icc, lossless=True)
    expected = 255 * srgb_of(levels / 255, *SPACES[space])
    np.testing.assert_allclose(255 * read_image(file), expected, atol=1.5)
    assert abs(expected - levels).mean() > 5  # else nothing would be shown


def test_a_photograph_as_phones_write_it_is_read_as_it_was_seen(tmp_path):
    levels, icc = np.full((16, 16, 3), (204, 77, 51), np.uint8), profile(*SPACES["Display P3"])
    Image.fromarray(levels).save(tmp_path / "a.jpg", quality=100, subsampling=0, icc_profile=icc)
    expected = 255 * srgb_of(levels[0, 0] / 255, *SPACES["Display P3"])
    np.testing.assert_allclose(255 * read_image(tmp_path / "a.jpg")[8, 8], expected, atol=2.5)


def test_alpha_stays_and_colours_are_premultiplied_afterwards(tmp_path, levels):
    rgba = np.concatenate([levels, levels[..., :1]], axis=-1)
    found = read_image(written(tmp_path / "a.png", rgba, profile(*SPACES["Display P3"])))
    plain = read_image(written(tmp_path / "b.png", levels, profile(*SPACES["Display P3"])))
    np.testing.assert_array_equal(found[..., 3], levels[..., 0].astype(np.float32) / 255)
    np.testing.assert_array_equal(found[..., :3], plain * found[..., 3:])


def test_what_is_srgb_already_keeps_its_bits(tmp_path, levels):
    """By Pillow's profile and by ours; and so does what no profile of RGB can be read from."""
    grey = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
    for icc in (None, ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes(), profile(SRGB, SRGB_CURVE),
                b"no profile", profile(DISPLAY_P3, SRGB_CURVE)[:200], grey):
        found = read_image(written(tmp_path / "a.png", levels, icc))
        np.testing.assert_array_equal(found, levels.astype(np.float32) / 255)


@pytest.mark.parametrize("mode", ["L", "LA", "I;16"])
def test_grey_becomes_that_of_srgb(tmp_path, mode):
    levels = np.arange(256).reshape(16, 16) * (257 if mode == "I;16" else 1)
    pixels = levels.astype(np.uint16 if mode == "I;16" else np.uint8)
    pixels = np.stack([pixels, np.full_like(pixels, 51)], axis=-1) if mode == "LA" else pixels
    found = read_image(written(tmp_path / "a.png", pixels, grey(1.8)))
    light = (np.arange(256) / 255) ** (461 / 256)  # 1.8, as a profile can hold it
    expected = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055).reshape(16, 16, 1)
    if mode == "LA":
        assert (found[..., 3] == np.float32(0.2)).all()
        found = found[..., :3] / 0.2
    assert found.shape == (16, 16, 3) and abs(expected.ravel() - np.arange(256) / 255).max() > 0.04
    np.testing.assert_allclose(255 * found, 255 * np.broadcast_to(expected, found.shape), atol=1.5)


def test_grey_without_a_whole_profile_keeps_its_bits(tmp_path):
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    for icc in (None, grey(1.8)[:150]):
        found = read_image(written(tmp_path / "a.png", levels, icc))
        np.testing.assert_array_equal(found, np.repeat(levels[..., None], 3, axis=2).astype(np.float32) / 255)


def adobe_tags(index: str) -> Image.Exif:
    tags = Image.Exif()
    tags[ExifTags.IFD.Exif] = {ExifTags.Base.ColorSpace: 65535, ExifTags.IFD.Interop: {1: index, 2: b"0100"}}
    return tags


@pytest.mark.parametrize("index", ["R03", "R98"])
def test_adobe_rgb_may_be_named_by_exif_alone(tmp_path, levels, index):
    Image.fromarray(levels).save(tmp_path / "a.png", exif=adobe_tags(index))
    expected = srgb_of(levels / 255, *SPACES["Adobe RGB"]) if index == "R03" else levels / 255
    np.testing.assert_allclose(255 * read_image(tmp_path / "a.png"), 255 * expected, atol=1)


def coded(file: Path, levels: np.ndarray, *code: int, icc: bytes | None = None) -> Path:
    """A PNG with the chunk cICP behind its header."""
    content = written(file, levels, icc).read_bytes()
    chunk = b"cICP" + bytes(code)
    file.write_bytes(content[:33] + struct.pack(">I", 4) + chunk + struct.pack(">I", zlib.crc32(chunk)) + content[33:])
    return file


@pytest.mark.parametrize("channels", [3, 4])
def test_what_a_png_codes_comes_before_its_profile(tmp_path, levels, channels):
    pixels = np.concatenate([levels, np.full_like(levels[..., :1], 255)], axis=-1)[..., :channels]
    adobe = profile(*SPACES["Adobe RGB"])
    wide = read_image(coded(tmp_path / "a.png", pixels, 12, 13, 0, 1, icc=adobe))
    expected = 255 * srgb_of(levels / 255, *SPACES["Display P3"])
    np.testing.assert_allclose(255 * wide[..., :3], expected, atol=1)
    usual = read_image(coded(tmp_path / "b.png", pixels, 1, 13, 0, 1, icc=adobe))
    np.testing.assert_array_equal(usual, pixels.astype(np.float32) / 255)


@pytest.mark.parametrize("code", [(9, 16, 0, 1), (9, 18, 0, 1), (11, 13, 0, 1), (1, 13, 0, 0), (1, 13, 1, 1)])
def test_colours_of_a_png_that_are_not_read_are_refused(tmp_path, levels, code):
    with pytest.raises(DataError, match=f"{'/'.join(map(str, code))} by cICP, are not read; save it as sRGB"):
        read_image(coded(tmp_path / "a.png", levels, *code))


def test_cmyk_becomes_srgb_by_its_profile_and_is_refused_without(tmp_path):
    black = np.zeros((8, 8, 4), np.uint8)
    black[..., 3] = 128
    image = Image.fromarray(black, "CMYK")
    image.save(tmp_path / "a.tif", icc_profile=black_of_cmyk())
    relative = ((100 * (1 - 128 / 255) + 16) / 116) ** 3  # Y of that L*
    expected = 255 * (1.055 * relative ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(255 * read_image(tmp_path / "a.tif"), expected, atol=2)
    image.save(tmp_path / "b.jpg")
    with pytest.raises(DataError, match="b.jpg.*its CMYK has no profile .*; save it as RGB"):
        read_image(tmp_path / "b.jpg")


@pytest.mark.parametrize("wide", ["all", "all but one"])
def test_points_of_colmap_have_the_colours_of_photographs_that_share_a_space(tmp_path, wide):
    colmap_folder(tmp_path)
    files = sorted((tmp_path / "images").iterdir())
    for file in files[wide != "all" :]:
        with Image.open(file) as image:
            image.save(file, icc_profile=profile(*SPACES["Display P3"]))
    dataset = load_dataset(tmp_path)
    raw = np.array([200, 100, 50]) / 255
    expected = srgb_of(raw, *SPACES["Display P3"]) if wide == "all" else raw
    np.testing.assert_allclose(255 * dataset.point_colors, np.tile(255 * expected, (9, 1)), atol=1)
    assert abs(srgb_of(raw, *SPACES["Display P3"]) - raw).max() > 0.03
    difference = check_cameras(dataset).color_difference
    assert difference is not None and (wide != "all" or difference < 1e-6)
