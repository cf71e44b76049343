"""PSNR of the right half after the exposure was fitted on the left one."""

import numpy as np
import pytest
from mi_dogsplat.measure.half_fit import fitted_gains, half_psnr
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.reference.image_formation import formed
from mi_dogsplat.scene.appearance import radii_squared
from mi_dogsplat.scene.cameras import Camera

CAMERA = Camera(np.eye(4), 30.0, 30.0, 15.0, 10.0, 30, 20)
R_SQ = radii_squared(CAMERA)
GAINS, VIGNETTING = [-0.8, 0.3, 0.1], [-0.4, -0.2]
IMAGE = np.random.default_rng(0).uniform(0.05, 0.7, (20, 30, 3))
TRUTH = formed(IMAGE, R_SQ, np.array([*GAINS, *VIGNETTING]))


def test_the_gains_of_a_photograph_are_found_where_the_vignetting_is_known():
    found = fitted_gains(IMAGE.reshape(-1, 3), TRUTH.reshape(-1, 3), R_SQ.ravel(), VIGNETTING)
    assert found == pytest.approx(GAINS, abs=1e-4)
    assert half_psnr(IMAGE, TRUTH, R_SQ, VIGNETTING) > 80 > 40 > psnr(IMAGE, TRUTH)
    assert half_psnr(IMAGE, TRUTH, R_SQ) < 50


def test_the_left_half_is_fitted_and_the_right_one_measured():
    noise = np.random.default_rng(1).normal(size=IMAGE.shape) * 0.05
    left, right = noise.copy(), noise.copy()
    left[:, 15:], right[:, :15] = 0, 0
    clean = half_psnr(IMAGE, TRUTH, R_SQ, VIGNETTING)
    assert half_psnr(IMAGE, TRUTH + right, R_SQ, VIGNETTING) == pytest.approx(psnr(noise, 0 * noise), abs=4)
    assert 30 < half_psnr(IMAGE, TRUTH + left, R_SQ, VIGNETTING) < clean


def test_masks_choose_pixels_of_both_halves():
    mask, broken = np.ones((20, 30)), TRUTH.copy()
    mask[:5], broken[:5] = 0, 0.5
    assert half_psnr(IMAGE, broken, R_SQ, VIGNETTING, mask) > 80 > 30 > half_psnr(IMAGE, broken, R_SQ, VIGNETTING)
    only_left = np.zeros((20, 30))
    only_left[:, :10] = 1
    assert half_psnr(IMAGE, TRUTH, R_SQ, VIGNETTING, only_left) > 80
    assert half_psnr(IMAGE, TRUTH, R_SQ, VIGNETTING, 1 - only_left) > 80
