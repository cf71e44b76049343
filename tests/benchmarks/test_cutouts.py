"""Things that are pasted into photographs are where their masks say, and nowhere else."""

import numpy as np
import pytest
from mi_dogsplat.support.errors import DataError
from PIL import Image

from benchmarks.training.cutouts import HEIGHTS, pictures_of, with_a_thing
from benchmarks.training.disagreement import main


@pytest.fixture
def things(tmp_path):
    """A picture of a thing of 40 x 60 pixels within one of 100 x 100."""
    folder = tmp_path / "things"
    folder.mkdir()
    pixels = np.zeros((100, 100, 4), np.uint8)
    pixels[20:80, 30:70] = (250, 120, 20, 255)
    Image.fromarray(pixels).save(folder / "a.png")
    return folder


def test_a_photograph_changes_where_the_mask_says(things):
    grey, rng = np.full((120, 160, 3), 0.5), np.random.default_rng(0)
    sizes = []
    for _ in range(30):
        pixels, seen = with_a_thing(grey, pictures_of(things), rng)
        assert pixels.shape == grey.shape and 0 <= pixels.min() and pixels.max() <= 1
        assert np.abs(pixels - grey)[~seen].max() <= 0.02
        changed = np.abs(pixels - grey).max(axis=2) > 0.05
        assert changed[seen].mean() > 0.9
        sizes.append(np.ptp(np.nonzero(seen)[0]) + 1)
    assert 0.75 * HEIGHTS[0] * 120 < min(sizes) and max(sizes) <= HEIGHTS[1] * 120 + 1 and len(set(sizes)) > 10


def test_pictures_without_alpha_are_refused(things, tmp_path):
    with pytest.raises(DataError, match="holds no .png"):
        pictures_of(tmp_path)
    Image.new("RGB", (4, 4)).save(things / "0.png")
    with pytest.raises(DataError, match="0.png: is of the mode RGB; give pictures with alpha"):
        pictures_of(things)


def test_what_is_in_the_way_needs_things(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main([str(tmp_path), "-o", str(tmp_path / "out"), "--in-the-way", "0.5"])
    assert "needs --things" in capsys.readouterr().err
