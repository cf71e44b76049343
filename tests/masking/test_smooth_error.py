"""Differences of photographs and renders: exposure does not count, and neighbours are averaged."""

import numpy as np
import pytest
from mi_dogsplat.masking.errors import BLUR, gains, smooth_error

RNG = np.random.default_rng(0)


def test_gains_are_the_best_in_l1():
    render, photograph = RNG.uniform(0, 1, (301, 3)), RNG.uniform(0, 1, (301, 3))
    found = gains(render, photograph)
    for c in range(3):
        grid = np.linspace(0.1, 3, 5_801)
        losses = np.abs(grid[:, None] * render[:, c] - photograph[:, c]).sum(1)
        assert np.abs(found[c] * render[:, c] - photograph[:, c]).sum() <= losses.min() + 1e-3


def test_gains_are_those_of_most_pixels():
    render = RNG.uniform(0.1, 1, (1_000, 3))
    photograph = render * (0.7, 1.1, 0.9)
    photograph[:400] = (0.9, 0.8, 0.1)  # something yellow that stands there
    np.testing.assert_allclose(gains(render, photograph), (0.7, 1.1, 0.9), atol=1e-12)


@pytest.mark.parametrize("render", [np.zeros((5, 3)), np.zeros((0, 3))], ids=["black", "no pixel"])
def test_without_light_nothing_is_fitted(render):
    np.testing.assert_array_equal(gains(render, np.full_like(render, 0.3)), 1)


def test_an_error_of_exposure_is_none_and_one_of_an_area_stays():
    render = RNG.uniform(0.2, 0.6, (60, 80, 3)).astype(np.float32)
    photograph = render * 1.4
    photograph[20:40, 30:50] += 0.1
    everything = np.ones((60, 80), bool)
    error = smooth_error(render, photograph, everything, everything)
    assert error.dtype == np.float32 and error[:15].max() < 1e-6
    np.testing.assert_allclose(error[26:34, 36:44], 0.1, atol=1e-4)
    np.testing.assert_allclose(error[19:21, 40].mean(), 0.05, atol=1e-3)  # an edge: half of its neighbours are wrong


def test_fine_detail_is_averaged():
    """A chessboard has the error of its mean everywhere."""
    board = 0.2 * (np.indices((200, 200)).sum(0) % 2)[..., None].repeat(3, axis=2)
    assert BLUR * 200 == 2
    everything = np.ones((200, 200), bool)
    error = smooth_error(np.full((200, 200, 3), 0.5), 0.5 + board, np.zeros_like(everything), everything)
    np.testing.assert_allclose(error, 0.1, atol=0.005)


def test_what_is_not_known_is_left_out():
    render = np.full((40, 40, 3), 0.5)
    photograph = render.copy()
    photograph[:, 20:] = 1
    known = np.broadcast_to(np.arange(40) < 20, (40, 40))
    error = smooth_error(render, photograph, known, known)
    assert not error[:, :20].any()
    assert not smooth_error(render, photograph, ~known & known, ~known & known).any()


def test_pixels_that_do_not_count_have_an_error_too():
    """As what was masked in the round before."""
    render = np.full((40, 40, 3), 0.5)
    photograph = render.copy()
    photograph[:, 30:] = 1
    counts = np.broadcast_to(np.arange(40) < 30, (40, 40))
    error = smooth_error(render, photograph, counts, np.ones((40, 40), bool))
    np.testing.assert_allclose(error[:, 35:], 0.5, atol=1e-3)
    np.testing.assert_allclose(error[:, :25], 0, atol=1e-3)
