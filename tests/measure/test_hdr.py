"""Measures of linear radiance: they see lamps and shadows, in any unit."""

import flip_evaluator
import numpy as np
import pytest
from mi_dogsplat.measure.hdr import evaluate_radiance, hdr_flip, psnr_mu
from mi_dogsplat.measure.metrics import PSNR_CAP, psnr
from mi_dogsplat.support.srgb import displayed

RNG = np.random.default_rng(0)
TRUTH = RNG.uniform(0.01, 0.8, (24, 32, 3)) ** 2
TRUTH[5:12, 6:14] = 30.0  # a lamp
DIM = TRUTH.copy()
DIM[5:12, 6:14] = 10.0  # which a screen shows alike


def test_what_is_the_same_has_no_error():
    assert evaluate_radiance(TRUTH, TRUTH) == {"psnr_mu": PSNR_CAP, "hdr_flip": 0.0}


def test_an_error_above_white_is_seen_where_a_screen_shows_none():
    assert psnr(displayed(DIM), displayed(TRUTH)) == PSNR_CAP
    found = evaluate_radiance(DIM, TRUTH)
    assert found["psnr_mu"] < 35 and found["hdr_flip"] > 0.01


def test_the_unit_of_radiance_does_not_matter():
    one, other = evaluate_radiance(DIM, TRUTH), evaluate_radiance(1000 * DIM, 1000 * TRUTH)
    assert other["psnr_mu"] == pytest.approx(one["psnr_mu"], abs=1e-6)
    assert other["hdr_flip"] == pytest.approx(one["hdr_flip"], abs=1e-4)


def test_psnr_mu_is_that_of_the_curve():
    x, y = 0.25, 0.5
    a, b = np.full((4, 4, 3), x), np.full((4, 4, 3), y)
    a[0, 0], b[0, 0] = 2.0, 2.0  # the brightest value of the truth
    error = (np.log(1 + 5000 * x / 2) - np.log(1 + 5000 * y / 2)) / np.log(5001)
    assert psnr_mu(a, b) == pytest.approx(-10 * np.log10(error**2 * 15 / 16))


def test_pixels_that_do_not_count_do_not():
    mask = np.ones((24, 32))
    mask[5:12, 6:14] = 0
    assert evaluate_radiance(DIM, TRUTH, mask) == {"psnr_mu": PSNR_CAP, "hdr_flip": 0.0}


@pytest.mark.parametrize("brighter", [1, 100, 1e35])
def test_a_lamp_that_does_not_count_says_nothing_of_how_bright_the_rest_is(brighter):
    mask, lamp = np.ones((24, 32)), TRUTH.copy()
    mask[5:12, 6:14] = 0
    lamp[5:12, 6:14] *= brighter
    assert evaluate_radiance(0.9 * lamp, lamp, mask) == evaluate_radiance(0.9 * TRUTH, TRUTH, mask)
    rest = slice(12, None)
    mask[:12] = 0
    assert psnr_mu(0.9 * lamp, lamp, mask) == psnr_mu(0.9 * TRUTH[rest], TRUTH[rest])


def test_the_library_is_given_the_exposures_that_it_would_find_itself():
    own, _, _ = flip_evaluator.evaluate(np.float32(TRUTH), np.float32(DIM), "HDR", applyMagma=False)
    assert hdr_flip(DIM, TRUTH) == pytest.approx(float(np.mean(own)), rel=0.02)


def test_a_picture_that_is_black_but_for_a_lamp_has_a_measure():
    lamp = np.zeros((16, 16, 3))
    lamp[4:8, 4:8] = 100
    assert hdr_flip(lamp, lamp) == 0 and 0.01 < hdr_flip(lamp / 8, lamp) < 1


def test_black_pictures_have_measures_too():
    black = np.zeros((16, 16, 3))
    assert psnr_mu(black, black) == PSNR_CAP and np.isfinite(hdr_flip(black, black))


@pytest.mark.parametrize("bad", [TRUTH[1:], -TRUTH, TRUTH * np.nan, TRUTH * np.inf, TRUTH[..., :2]])
def test_what_is_no_radiance_is_refused(bad):
    with pytest.raises(ValueError, match="radiance|both need"):
        evaluate_radiance(bad, TRUTH)
