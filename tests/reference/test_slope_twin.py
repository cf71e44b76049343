"""The float64 twin of colours that vary over their primitive: by hand, in samples of space, against differences."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.reference.forward import RAW_PARAMETERS, colors_at
from mi_dogsplat.reference.gradients import gradients_tiled, render_tiled
from mi_dogsplat.reference.rays import gather, meet
from mi_dogsplat.scene.splats import Splats
from splat_scenes import axis_rotation, make_camera, make_splats, random_splats, rounded, tilted_camera

BACKGROUND = (0.2, -0.3, 0.6)
SMOOTH: dict[str, Any] = {"min_alpha": 0, "min_transmittance": 0}
MODES = [{"antialiased": a, "negative_transmittance": n} for a in (False, True) for n in (True, False)]
SMALL = tilted_camera(20, 18, f=18.0, cx=8.0, cy=9.5)  # four tiles
ADJOINT = np.random.default_rng(0).normal(size=(18, 20, 3))


def with_slopes(splats: Any, slopes: Any, rows: Any = (0,)) -> Any:
    splats.slope_index, splats.color_slopes = np.asarray(rows), np.reshape(np.asarray(slopes, float), (-1, 3, 3))
    return splats


# --- by hand ---


def test_one_standard_deviation_to_the_right_the_colour_has_changed_by_the_slope():
    """Large on the screen, so that the low-pass filter is next to nothing: 60 px to a standard deviation."""
    camera = make_camera(f=600.0)
    slopes = np.array([[0.3, -0.2, 0.1], [0.01, 0.02, -0.03], [5, 6, 7]])
    splats = with_slopes(make_splats([0, 0, 2], (0.2, 0.4, 0.3), colors=(0.5, 0.4, 0.2)), slopes)
    p = reference.project(splats, camera)
    x, y = (p.means2d[0] + [[0, 0], [60, 0], [-60, 0], [0, 132], [60, 264]]).T
    expected = np.array([0.5, 0.4, 0.2]) + [[0, 0, 0], slopes[0], -slopes[0], slopes[1], slopes[0] + 2 * slopes[1]]
    np.testing.assert_allclose(colors_at(p, 0, x, y), expected, atol=3e-5)


def test_the_low_pass_filter_flattens_what_is_smaller_than_a_pixel():
    """V is s = .3 px wide: w = s d / (s^2 + .3)."""
    splats = with_slopes(make_splats([0, 0, 2], 0.01), np.eye(3))
    slopes = reference.project(splats, make_camera(f=60.0)).slopes[0]
    np.testing.assert_allclose(slopes[0], [0.3 / (0.3**2 + 0.3), 0], rtol=1e-12)
    np.testing.assert_allclose(slopes[1], [0, 0.33 / (0.33**2 + 0.3)], rtol=1e-12)
    assert not slopes[2].any()  # the axis of the line of sight


def test_the_colour_of_a_pixel_is_the_mean_of_what_lies_behind_it():
    """Samples of a turned primitive, blurred by the filter: their regression on the place in the image."""
    quat = axis_rotation([0.3, -0.5, 0.8], 1.1)[1]
    splats = with_slopes(make_splats([0.2, -0.1, 3], (0.2, 0.1, 0.3), quats=quat),
                         np.random.default_rng(1).normal(size=(3, 3)))  # fmt: skip
    camera = tilted_camera(f=20.0)
    p, R = reference.project(splats, camera), reference.rotations(splats.quats)[0]
    w = np.random.default_rng(0).normal(size=(4_000_000, 3))
    w = np.concatenate([w, -w])
    offsets = w * 1e-3 * np.exp(splats.log_scales[0]) @ R.T  # so near that the projection is linear
    d = (camera.project(splats.means[0] + offsets)[0] - p.means2d[0]) / 1e-3
    d += np.sqrt(reference.LOW_PASS) * np.random.default_rng(2).normal(size=d.shape)
    measured = np.linalg.lstsq(d, w @ splats.color_slopes[0], rcond=None)[0].T
    np.testing.assert_allclose(measured, p.slopes[0], atol=2e-3 * np.abs(p.slopes).max())


def test_a_turned_primitive_shows_its_own_axes():
    quat = axis_rotation([0, 0, 1], np.pi / 2)[1]  # its x axis is down the image, its y axis to the left
    splats = with_slopes(make_splats([0, 0, 2], (0.2, 0.4, 0.3), quats=quat), np.diag([1, 1, 0]))
    slopes = reference.project(splats, make_camera(f=60.0)).slopes[0]
    assert slopes[0, 1] > 0.1 and slopes[1, 0] < -0.05 and np.abs(slopes[[0, 1], [0, 1]]).max() < 1e-12


def test_colours_below_zero_are_shown_as_they_are():
    splats = with_slopes(make_splats([0, 0, 2], 0.3, 0.9, 0.1), 0.5 * np.ones((3, 3)))
    image = reference.render(splats, make_camera(20, 16, 20.0))[0]
    assert image.min() < -0.05 and image.max() > 0.15


# --- images ---


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("dog_share", [0, 0.5])
@pytest.mark.parametrize("choices", MODES)
def test_the_tiled_twin_shows_what_the_plain_one_does(dog_share, smooth, choices):
    splats, camera = random_splats(60, seed=1, dog_share=dog_share, slope_share=0.6), tilted_camera(53, 37)
    image, T, _ = reference.render(splats, camera, BACKGROUND, smooth=smooth, **choices)
    ours = render_tiled(splats, camera, BACKGROUND, **choices, **(SMOOTH if smooth else {}))
    np.testing.assert_allclose(ours.image, image, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(ours.T, T, rtol=1e-12, atol=1e-12)


def test_slopes_of_zero_change_nothing_and_others_only_pixels_of_their_primitives():
    splats, camera = rounded(random_splats(20, seed=1)), tilted_camera(53, 37)
    even = render_tiled(splats, camera)
    zero = replace(splats, slope_index=np.arange(20), color_slopes=np.zeros((20, 3, 3)))
    np.testing.assert_allclose(render_tiled(zero, camera).image, even.image, atol=1e-15)
    some = replace(splats, slope_index=[3, 7], color_slopes=np.ones((2, 3, 3)))
    changed = render_tiled(some, camera)
    np.testing.assert_array_equal(changed.T, even.T)
    weights = reference_score.weights(splats, camera)[0]
    assert np.abs(changed.image - even.image).max() > 0.01
    np.testing.assert_array_equal((changed.image != even.image).all(-1), (weights[[3, 7]] != 0).any(0))


def test_a_primitive_whose_slopes_are_not_finite_is_not_visible():
    splats = random_splats(5, slope_share=1)
    splats.color_slopes[2, 1, 0] = np.nan
    splats.color_slopes[3, 0, 2] = np.inf
    np.testing.assert_array_equal(reference.project(splats, make_camera()).visible, [True, True, False, False, True])


# --- gradients ---


def assert_gradients_equal(got: dict, expected: dict, rtol=1e-6):
    assert tuple(got) == tuple(expected) == (*RAW_PARAMETERS, "color_slopes")
    for name, values in expected.items():
        atol = 0.1 * rtol * np.abs(values).max(initial=0)
        np.testing.assert_allclose(got[name], values, rtol=rtol, atol=atol, err_msg=name)


@pytest.mark.parametrize("choices", MODES)
@pytest.mark.parametrize("dog_share", [0, 0.5])
@pytest.mark.parametrize("slope_share", [0.5, 1])
def test_gradients_of_every_parameter_equal_differences(dog_share, slope_share, choices):
    splats = random_splats(6, seed=5, degree=1, dog_share=dog_share, slope_share=slope_share)
    assert (len(splats.slope_index) == 6) == (slope_share == 1) and len(splats.slope_index) > 1
    expected = reference.loss_gradients(splats, SMALL, ADJOINT, background=BACKGROUND, **choices)
    got = gradients_tiled(splats, SMALL, ADJOINT, BACKGROUND, **choices, **SMOOTH)
    assert all(np.abs(values).max() > 1e-2 for values in got.values() if values.size)
    assert_gradients_equal(got, expected)


@pytest.mark.parametrize("seed", [6, 7])
def test_gradients_with_cutoffs_and_at_limits_equal_differences(seed):
    splats = random_splats(10, seed=seed, degree=1, slope_share=1)
    splats.logit_opacities[:2] = 8  # saturated
    splats.log_scales[:2] = 1
    splats.sh_coeffs[3, 0] = -5  # black at the centre: clamped there, its slopes are not
    splats.means[4, 0] = 9  # seen from the side, where the linearisation is clamped
    splats.log_scales[4] = 1
    expected = reference.loss_gradients(splats, SMALL, ADJOINT, background=BACKGROUND, smooth=False, eps=1e-6)
    assert not expected["sh_coeffs"][3].any() and expected["color_slopes"][3].any()
    assert_gradients_equal(gradients_tiled(splats, SMALL, ADJOINT, BACKGROUND), expected, rtol=1e-5)


def test_primitives_that_are_not_seen_have_no_gradient():
    splats = random_splats(9, seed=8, slope_share=0.7)
    got = gradients_tiled(splats, SMALL, ADJOINT, near_clip=2.5)
    seen = reference.project(splats, SMALL, near_clip=2.5).visible[splats.slope_index]
    assert 0 < seen.sum() < len(seen)
    assert got["color_slopes"][seen].any((1, 2)).all() and not got["color_slopes"][~seen].any()


def test_a_mixed_model_has_gradients_of_both_groups():
    splats = replace(rounded(random_splats(6, seed=3)).with_sh_degrees(np.arange(6) % 3),
                     slope_index=[1, 2, 5], color_slopes=np.ones((3, 3, 3)) / 3)  # fmt: skip
    expected = reference.loss_gradients(splats, SMALL, ADJOINT, keys=["color_slopes", "sh2_coeffs", "means"])
    got = gradients_tiled(splats, SMALL, ADJOINT, **SMOOTH)
    assert tuple(got) == (*RAW_PARAMETERS, "color_slopes", "sh1_coeffs", "sh2_coeffs")
    for name, values in expected.items():
        np.testing.assert_allclose(got[name], values, rtol=1e-6, atol=1e-7 * np.abs(values).max(), err_msg=name)


# --- scores and rays ---


def test_a_footprint_is_what_the_picture_gains_with_the_primitive():
    """Of one that hides nothing: its alpha times its colour less that of the background, at each pixel."""
    splats, camera = with_slopes(make_splats([0, 0, 2], 0.3, 0.6), np.arange(9) / 9), make_camera(20, 16, 20.0)
    footprint = reference_score.footprints(splats, camera, BACKGROUND)[0]
    with_it = reference.render(splats, camera, BACKGROUND)[0] - BACKGROUND
    alpha = reference_score.weights(splats, camera)[0][0]
    np.testing.assert_allclose(footprint * alpha, 0.6 * with_it.sum(-1), atol=1e-12)
    assert alpha.max() > 0.5


def test_the_colour_on_a_ray_is_that_of_the_point_where_the_kernel_is_largest():
    quat = axis_rotation([0.3, -0.5, 0.8], 1.1)[1]
    splats = with_slopes(make_splats([[0.2, -0.1, 3], [0, 0, 9]], (0.2, 0.1, 0.3), colors=0.4, quats=quat,
                                     dog=[1]), np.arange(18) / 9, [0, 1])  # fmt: skip
    origins, directions = np.array([[0, 0, 0], [0.5, 0.1, 1]]), np.array([[0.1, 0, 1], [-0.1, -0.1, 2]])
    colors = meet(splats, origins, directions, smooth=True).colors
    R, scales, along = reference.rotations(splats.quats), np.exp(splats.log_scales), np.linspace(0, 12, 600_001)
    for ray in range(2):
        points = origins[ray] + along[:, None] * directions[ray]
        for i in range(2):
            w = (points - splats.means[i]) @ R[i] / scales[i]
            nearest = w[(w**2).sum(1).argmin()]
            np.testing.assert_allclose(colors[ray, i], 0.4 + nearest @ splats.color_slopes[i], atol=1e-3)


def test_a_ray_sees_what_a_pixel_does_where_the_primitive_is_small_and_the_filter_smaller():
    camera = make_camera(20, 16, 4000.0)
    splats: Splats = with_slopes(make_splats([0, 0, 2], (0.002, 0.003, 0.001), 0.6), np.arange(9) / 9)
    image = reference.render(splats, camera, smooth=True)[0]
    x, y = reference.pixel_centres(0, 0, 20, 16)
    directions = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], -1)
    colors, _ = gather(meet(splats, np.zeros((len(x), 3)), directions, smooth=True), smooth=True)
    np.testing.assert_allclose(colors.reshape(image.shape), image, atol=0.02 * np.ptp(image))
