"""Photographs that are made to disagree do so as much as was asked for."""

import numpy as np
import pytest
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.support.srgb import srgb_to_linear

from benchmarks.training.disagreement import REACH, exposed, main, moved


def test_things_move_by_the_given_distance_and_their_neighbours_with_them():
    height, width = 240, 360
    ramps = np.stack(np.broadcast_arrays(np.arange(width) / width, np.arange(height)[:, None] / height, 0.0), -1)
    by = (moved(ramps, 4.0, np.random.default_rng(0)) - ramps)[..., :2] * [width, height]
    inner = by[20:-20, 20:-20]  # a ramp tells how far it has moved, but at its ends
    np.testing.assert_allclose(np.sqrt((inner**2).mean((0, 1))), 4.0, rtol=0.15)
    assert np.abs(np.diff(inner, axis=0)).max() < 4 * 4.0 / REACH


def test_each_photograph_has_another_exposure_within_the_given_one():
    grey = np.full((2, 3, 3), 0.4)
    rng = np.random.default_rng(0)
    ev = [np.log2(srgb_to_linear(exposed(grey, 0.25, rng)) / srgb_to_linear(grey)) for _ in range(40)]
    np.testing.assert_allclose(np.ptp(ev, axis=(1, 2, 3)), 0.0, atol=1e-5)
    assert np.ptp(ev) > 0.4 and np.abs(ev).max() <= 0.25 + 1e-5
    assert exposed(np.ones((1, 1, 3)), 4.0, np.random.default_rng(1)).max() <= 1.0


def test_what_is_no_colmap_model_is_refused_and_no_photograph_overwritten(tmp_path):
    with pytest.raises(DataError, match="holds no COLMAP model"):
        main([str(tmp_path), "-o", str(tmp_path / "out")])
    (tmp_path / "photograph.jpg").touch()
    with pytest.raises(DataError, match="is not empty; name a new folder"):
        main([str(tmp_path), "-o", str(tmp_path)])
