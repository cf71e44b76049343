"""Photographs whose ICC profile names another space than sRGB are read as what they show."""

from pathlib import Path

import numpy as np
import pytest
from icc_profiles import ADOBE_CURVE, ADOBE_RGB, DISPLAY_P3, SRGB, SRGB_CURVE, profile, srgb_of
from mi_dogsplat.datasets.images import read_image
from PIL import Image, ImageCms

SPACES = {"Display P3": (DISPLAY_P3, SRGB_CURVE), "Adobe RGB": (ADOBE_RGB, ADOBE_CURVE)}


def written(file: Path, levels: np.ndarray, icc: bytes | None) -> Path:
    Image.fromarray(levels).save(file, icc_profile=icc)
    return file


@pytest.fixture
def levels() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)


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
