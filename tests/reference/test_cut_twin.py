"""The float64 twin of primitives that a plane cuts off: by hand, against differences, on rays."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.reference.forward import kernels
from mi_dogsplat.reference.gradients import gradients_tiled, render_tiled
from mi_dogsplat.reference.rays import meet
from own_axes_models import CUT, PLANE_KINDS, SECOND_CUT, nearest_on_ray
from splat_scenes import axis_rotation, make_camera, make_splats, random_splats, rounded, tilted_camera
from tiled_twin import BACKGROUND, SMALL, adjoint_of, assert_gradients_near, at_limits

ADJOINT = adjoint_of(SMALL)


def left(along: Any) -> Any:
    """g of n.w, as the pages have it."""
    return (1 + np.exp(-4)) / (1 + np.exp(-4 - np.asarray(along, float)))


# --- by hand ---


def test_a_kernel_is_multiplied_by_what_the_cut_leaves_there():
    """Large on the screen, so that the low-pass filter is next to nothing: 60 px to a standard deviation."""
    camera, shape = make_camera(f=600.0), ([0, 0, 2], (0.2, 0.4, 0.3))
    normal = np.array([3.0, -2.0, 7.0])
    splats = CUT.given(make_splats(*shape, dog=[0]), normal)
    p, whole = (reference.project(s, camera) for s in (splats, make_splats(*shape, dog=[0])))
    w = np.array([[0, 0], [1, 0], [-1, 0], [-4 / 3, 0], [0, 1], [0, 2], [-2, 1]])
    x, y = (p.means2d[0] + w * [60, 132]).T
    expected = left(w @ normal[:2])
    assert expected[0] == 1 and expected[2] < 0.75 and abs(expected[3] - (1 + np.exp(-4)) / 2) < 1e-12
    for cut, uncut in zip(kernels(p, 0, x, y), kernels(whole, 0, x, y), strict=True):
        np.testing.assert_allclose(cut, expected * uncut, rtol=2e-3)


def test_the_low_pass_filter_makes_cuts_of_tiny_primitives_gentle():
    """V is s = .3 px wide: w = s d / (s^2 + .3)."""
    splats = CUT.given(make_splats([0, 0, 2], 0.01), (2, 5, 9))
    ((cut,), _) = reference.project(splats, make_camera(f=60.0)).cuts
    np.testing.assert_allclose(cut, [2 * 0.3 / (0.3**2 + 0.3), 5 * 0.33 / (0.33**2 + 0.3)], rtol=1e-12)


@pytest.mark.parametrize("times", [9, 11, 1e3, 1e200])
def test_no_cut_is_steeper_than_sixteen_per_pixel(times):
    """The longer normals are shown in the same direction."""
    camera, shape, normal = make_camera(f=60.0), ([0, 0, 2], 0.02), np.array([1.0, 1.5, -2])
    (((gentle,), _), ((cut,), _)) = (reference.project(CUT.given(make_splats(*shape), n), camera).cuts
                                     for n in (normal, times * normal))  # fmt: skip
    length = np.hypot(*gentle)
    assert 9 * length < 16 < 11 * length
    np.testing.assert_allclose(cut, gentle * min(times, 16 / length), rtol=1e-12)


def test_a_cut_along_the_line_of_sight_is_not_seen():
    splats = CUT.given(make_splats([0, 0, 2], (0.2, 0.4, 0.3)), (0, 0, 50))
    camera = make_camera(f=60.0)
    image, whole = (reference.render(s, camera)[0] for s in (splats, make_splats([0, 0, 2], (0.2, 0.4, 0.3))))
    np.testing.assert_array_equal(image, whole)


def test_what_is_beyond_a_steep_cut_is_gone_and_the_rest_is_whole():
    camera, shape = make_camera(f=60.0), ([0, 0, 2], 0.3, 0.9)
    image, whole = (reference.render(s, camera)[0][24, :, 0]
                    for s in (CUT.given(make_splats(*shape), (400, 0, 0)), make_splats(*shape)))  # fmt: skip
    assert not image[:31].any() and whole[28:31].min() > 0.5
    np.testing.assert_allclose(image[33:], np.minimum(0.99, left(np.inf) * whole[33:]), rtol=1e-9)


@pytest.mark.parametrize(("planes", "opacity"), [((CUT,), 0.99), ((SECOND_CUT,), 0.99), (PLANE_KINDS, 0.98)])
def test_lists_hold_what_cuts_make_a_little_more_opaque(planes, opacity):
    """Alpha just below the cutoff at the centre, and above it towards the normal."""
    splats = make_splats([0, 0, 2], 5.0, opacity / 255)
    for kind in planes:
        splats = kind.given(splats, (40, 0, 0))
    camera = make_camera(f=60.0)
    p = reference.project(splats, camera)
    assert p.extents.min() > 0 and reference.render(splats, camera)[0].max() > 1 / 255
    np.testing.assert_allclose(render_tiled(splats, camera).image, reference.render(splats, camera)[0], rtol=1e-12)
    rays = meet(splats, np.zeros((1, 3)), np.array([[0.3, 0, 1]]))
    assert rays.alphas[0, 0] > 1 / 255


# --- images and gradients ---


def test_cuts_change_only_pixels_of_their_primitives():
    splats, camera = rounded(random_splats(20, seed=1)), tilted_camera(53, 37)
    some = replace(splats, cut_index=[3, 7], cut_normals=np.full((2, 3), -5))
    whole, changed = (render_tiled(s, camera) for s in (splats, some))
    footprints = [reference_score.weights(s, camera)[0][[3, 7]] for s in (splats, some)]
    elsewhere = ~np.any(footprints, axis=(0, 1))
    assert np.abs(changed.T - whole.T).max() > 0.01 and elsewhere.any()
    np.testing.assert_array_equal(changed.image[elsewhere], whole.image[elsewhere])


@pytest.mark.parametrize("seed", [6, 7])
@pytest.mark.parametrize("shares", [{"cut_share": 1}, {"cut_share": 1, "second_cut_share": 1}])
def test_gradients_with_cutoffs_and_at_limits_equal_differences(seed, shares):
    splats = at_limits(seed, **shares)
    expected = reference.loss_gradients(splats, SMALL, ADJOINT, background=BACKGROUND, smooth=False, eps=1e-6)
    assert expected["cut_normals"][:2].any(1).all()  # saturated but for where they are cut off
    assert_gradients_near(gradients_tiled(splats, SMALL, ADJOINT, BACKGROUND), expected, rtol=1e-5)


# --- rays ---


def test_a_ray_sees_the_cut_at_the_point_where_the_primary_is_largest():
    quat = axis_rotation([0.3, -0.5, 0.8], 1.1)[1]
    shape: Any = [[0.2, -0.1, 3], [0, 0, 6]], (0.8, 0.4, 1.2)
    normals = np.array([[2, -1, 3], [-4, 1, 2.0]])
    splats = CUT.given(make_splats(*shape, opacities=0.9, quats=quat, dog=[1]), normals, [0, 1])
    origins, directions = np.array([[0, 0, 0], [0.5, 0.1, 1]]), np.array([[0.1, 0, 1], [-0.1, -0.1, 2]])
    alphas = meet(splats, origins, directions, smooth=True).alphas
    whole = meet(make_splats(*shape, opacities=0.9, quats=quat, dog=[1]), origins, directions, smooth=True).alphas
    for ray, i in np.ndindex(2, 2):
        expected = left(nearest_on_ray(splats, i, origins[ray], directions[ray]) @ normals[i])
        assert abs(whole[ray, i]) > 0.05 and expected != 1
        np.testing.assert_allclose(alphas[ray, i], expected * whole[ray, i], rtol=1e-3)
