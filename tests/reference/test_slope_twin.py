"""The float64 twin of colours that vary over their primitive: by hand, against differences, on rays."""

from dataclasses import replace

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.reference.forward import RAW_PARAMETERS, colors_at
from mi_dogsplat.reference.gradients import gradients_tiled, render_tiled
from mi_dogsplat.reference.rays import meet
from own_axes_models import SLOPED, nearest_on_ray
from splat_scenes import axis_rotation, make_camera, make_splats, random_splats, rounded, tilted_camera
from tiled_twin import BACKGROUND, SMALL, adjoint_of, assert_gradients_near, at_limits

ADJOINT = adjoint_of(SMALL)


# --- by hand ---


def test_one_standard_deviation_to_the_right_the_colour_has_changed_by_the_slope():
    """Large on the screen, so that the low-pass filter is next to nothing: 60 px to a standard deviation."""
    camera = make_camera(f=600.0)
    slopes = np.array([[0.3, -0.2, 0.1], [0.01, 0.02, -0.03], [5, 6, 7]])
    splats = SLOPED.given(make_splats([0, 0, 2], (0.2, 0.4, 0.3), colors=(0.5, 0.4, 0.2)), slopes)
    p = reference.project(splats, camera)
    x, y = (p.means2d[0] + [[0, 0], [60, 0], [-60, 0], [0, 132], [60, 264]]).T
    expected = np.array([0.5, 0.4, 0.2]) + [[0, 0, 0], slopes[0], -slopes[0], slopes[1], slopes[0] + 2 * slopes[1]]
    np.testing.assert_allclose(colors_at(p, 0, x, y), expected, atol=3e-5)


def test_the_low_pass_filter_flattens_what_is_smaller_than_a_pixel():
    """V is s = .3 px wide: w = s d / (s^2 + .3)."""
    splats = SLOPED.given(make_splats([0, 0, 2], 0.01), np.eye(3))
    slopes = reference.project(splats, make_camera(f=60.0)).slopes[0]
    np.testing.assert_allclose(slopes[0], [0.3 / (0.3**2 + 0.3), 0], rtol=1e-12)
    np.testing.assert_allclose(slopes[1], [0, 0.33 / (0.33**2 + 0.3)], rtol=1e-12)
    assert not slopes[2].any()  # the axis of the line of sight


def test_a_turned_primitive_shows_its_own_axes():
    quat = axis_rotation([0, 0, 1], np.pi / 2)[1]  # its x axis is down the image, its y axis to the left
    splats = SLOPED.given(make_splats([0, 0, 2], (0.2, 0.4, 0.3), quats=quat), np.diag([1, 1, 0]))
    slopes = reference.project(splats, make_camera(f=60.0)).slopes[0]
    assert slopes[0, 1] > 0.1 and slopes[1, 0] < -0.05 and np.abs(slopes[[0, 1], [0, 1]]).max() < 1e-12


def test_colours_below_zero_are_shown_as_they_are():
    splats = SLOPED.given(make_splats([0, 0, 2], 0.3, 0.9, 0.1), 0.5 * np.ones((3, 3)))
    image = reference.render(splats, make_camera(20, 16, 20.0))[0]
    assert image.min() < -0.05 and image.max() > 0.15


# --- images and gradients ---


def test_slopes_change_only_pixels_of_their_primitives():
    splats, camera = rounded(random_splats(20, seed=1)), tilted_camera(53, 37)
    even = render_tiled(splats, camera)
    changed = render_tiled(replace(splats, slope_index=[3, 7], color_slopes=np.ones((2, 3, 3))), camera)
    np.testing.assert_array_equal(changed.T, even.T)
    weights = reference_score.weights(splats, camera)[0]
    assert np.abs(changed.image - even.image).max() > 0.01
    np.testing.assert_array_equal((changed.image != even.image).all(-1), (weights[[3, 7]] != 0).any(0))


@pytest.mark.parametrize("seed", [6, 7])
def test_gradients_with_cutoffs_and_at_limits_equal_differences(seed):
    splats = at_limits(seed, slope_share=1)
    splats.sh_coeffs[3, 0] = -5  # black at the centre: clamped there, its slopes are not
    expected = reference.loss_gradients(splats, SMALL, ADJOINT, background=BACKGROUND, smooth=False, eps=1e-6)
    assert not expected["sh_coeffs"][3].any() and expected["color_slopes"][3].any()
    assert tuple(expected) == (*RAW_PARAMETERS, "color_slopes")
    assert_gradients_near(gradients_tiled(splats, SMALL, ADJOINT, BACKGROUND), expected, rtol=1e-5)


# --- rays ---


def test_the_colour_on_a_ray_is_that_of_the_point_where_the_kernel_is_largest():
    quat = axis_rotation([0.3, -0.5, 0.8], 1.1)[1]
    splats = SLOPED.given(make_splats([[0.2, -0.1, 3], [0, 0, 9]], (0.2, 0.1, 0.3), colors=0.4, quats=quat, dog=[1]),
                          np.arange(18) / 9, [0, 1])  # fmt: skip
    origins, directions = np.array([[0, 0, 0], [0.5, 0.1, 1]]), np.array([[0.1, 0, 1], [-0.1, -0.1, 2]])
    colors = meet(splats, origins, directions, smooth=True).colors
    for ray, i in np.ndindex(2, 2):
        nearest = nearest_on_ray(splats, i, origins[ray], directions[ray])
        np.testing.assert_allclose(colors[ray, i], 0.4 + nearest @ splats.color_slopes[i], atol=1e-3)
