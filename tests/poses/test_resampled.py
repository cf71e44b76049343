"""Pixels that were resampled become files: what they hold when they are read again."""

import numpy as np
import pytest
from mi_dogsplat.poses.resampled import write_resampled
from PIL import Image


@pytest.mark.parametrize("name", ["a.jpg", "a.JPEG", "a.PNG"])
def test_levels_are_the_nearest_and_what_is_too_bright_or_dark_is_clipped(tmp_path, name):
    values = np.array([-0.2, 0, 99.6 / 255, 100.4 / 255, 1, 1.3], np.float32)
    write_resampled(np.broadcast_to(values.repeat(16)[:, None, None], (96, 16, 3)).copy(), tmp_path / name)
    with Image.open(tmp_path / name) as image:
        assert image.format == ("PNG" if name == "a.PNG" else "JPEG")
        found = np.asarray(image)[8::16, 8].astype(int)
    assert np.abs(found - np.array([0, 0, 100, 100, 255, 255])[:, None]).max() <= (name != "a.PNG")


def test_jpeg_keeps_colours_from_pixel_to_pixel(tmp_path):
    """A level or two, as fine print has them: chroma of half the size would lose more than 100."""
    red, blue = (0.8, 0.2, 0.2), (0.2, 0.2, 0.8)
    stripes = np.tile(np.array([red, blue], np.float32), (24, 12, 1))
    write_resampled(stripes, tmp_path / "a.jpg")
    with Image.open(tmp_path / "a.jpg") as image:
        assert np.abs(np.asarray(image, float) - 255 * stripes).max() < 4


def test_png_is_not_premultiplied(tmp_path):
    write_resampled(np.full((4, 4, 4), (0.4, 0.2, 0.1, 0.5), np.float32), tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as image:
        assert np.abs(np.asarray(image, float) - (204, 102, 51, 128)).max() <= 0.5
