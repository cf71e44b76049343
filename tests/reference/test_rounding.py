"""Bounds of what float32 changes: held by sums in float32, in proportion to what is added up, and not much wider."""

import numpy as np
import pytest
from mi_dogsplat.reference.gradients import render_tiled
from mi_dogsplat.reference.rounding import rounding_tiled
from splat_scenes import constant_layers, make_camera, random_splats, tilted_camera

CAMERA = make_camera(6, 5)
BACKGROUND = (0.25, 0.5, 1.0)


def in_single_precision(alphas, color: float, background: float) -> np.float32:
    """Layers of one colour over a background, every operation rounded."""
    one = np.float32
    C, T = one(0), one(1)
    for alpha in alphas:
        weight = one(alpha) * T
        C, T = C + weight * one(color), T - weight
    return C + T * one(background)


@pytest.mark.parametrize("alphas", [[0.3, -0.2] * 40, [-0.15] * 120, [0.01] * 300], ids=["both", "growing", "fading"])
def test_a_sum_in_float32_is_within_the_bound(alphas):
    splats = constant_layers(alphas)
    right, bound = render_tiled(splats, CAMERA, BACKGROUND), rounding_tiled(splats, CAMERA, BACKGROUND)
    for channel, color in enumerate((0.3, 0.6, 0.9)):
        single = in_single_precision(alphas, color, BACKGROUND[channel])
        exact = sum(color * a * np.prod(1 - np.array(alphas[:i])) for i, a in enumerate(alphas))
        exact += BACKGROUND[channel] * np.prod(1 - np.array(alphas))
        np.testing.assert_allclose(right.image[..., channel], exact, rtol=1e-4)
        assert (abs(single - exact) <= bound.error[..., channel]).all()
        assert (bound.error[..., channel] < 1e-3 * bound.magnitude[..., channel]).all()


def test_the_magnitude_is_the_image_where_no_alpha_is_negative_and_more_elsewhere():
    camera = tilted_camera(24, 20)
    for share in (0, 1):
        splats = random_splats(40, seed=3, dog_share=share)
        image, magnitude = render_tiled(splats, camera, BACKGROUND).image, rounding_tiled(splats, camera, BACKGROUND)
        if share:
            assert (magnitude.magnitude >= image - 1e-12).all() and (magnitude.magnitude > image + 0.01).any()
        else:
            np.testing.assert_allclose(magnitude.magnitude, image, rtol=1e-12, atol=1e-12)


def test_relative_errors_of_T_add_however_far_it_grows():
    bounds = [rounding_tiled(constant_layers([-0.1] * n), CAMERA, BACKGROUND) for n in (50, 100, 200)]
    small, middle, large = ((b.error / b.magnitude).mean() for b in bounds)
    assert middle / small == pytest.approx(2, rel=0.1) and large / middle == pytest.approx(2, rel=0.1)
    assert bounds[2].magnitude.mean() > 1e7


@pytest.mark.parametrize("off, alike", [(1e-6, False), (-1e-6, False), (1e-2, True), (-1e-2, True)])
@pytest.mark.parametrize("limit", [2.0**30, 1e-4])
def test_what_lies_on_a_cutoff_after_rounding_is_on_either_side_of_it(limit, off, alike):
    """The share by which cutoffs move is next to nothing here: what moves them is the rounding of the layers."""
    rate, count = (-0.5, 50) if limit > 1 else (0.2, 40)
    last = 1 - limit * (1 + off) / (1 - rate) ** count
    splats = constant_layers([rate] * count + [last, 0.5])
    strict, exact, lenient = (render_tiled(splats, CAMERA, moved=moved).T for moved in (1e-12, 0, -1e-12))
    assert np.array_equal(strict, lenient) == alike
    assert np.array_equal(exact, strict) or np.array_equal(exact, lenient)


def test_an_alpha_on_the_cutoff_is_on_either_side_of_it():
    for off, alike in ((1e-8, False), (1e-4, True)):
        splats = constant_layers([(1 + off) / 255])
        strict, lenient = (render_tiled(splats, CAMERA, moved=moved).T for moved in (1e-12, -1e-12))
        assert np.array_equal(strict, lenient) == alike
