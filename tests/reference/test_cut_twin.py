"""The float64 twin of primitives that a plane cuts off: by hand, in samples of space, against differences."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.reference.forward import RAW_PARAMETERS, kernels
from mi_dogsplat.reference.gradients import gradients_tiled, render_tiled
from mi_dogsplat.reference.rays import gather, meet
from splat_scenes import axis_rotation, make_camera, make_splats, random_splats, rounded, tilted_camera

BACKGROUND = (0.2, -0.3, 0.6)
SMOOTH: dict[str, Any] = {"min_alpha": 0, "min_transmittance": 0}
MODES = [{"antialiased": a, "negative_transmittance": n} for a in (False, True) for n in (True, False)]
SMALL = tilted_camera(20, 18, f=18.0, cx=8.0, cy=9.5)  # four tiles
ADJOINT = np.random.default_rng(0).normal(size=(18, 20, 3))


def with_cuts(splats: Any, normals: Any, rows: Any = (0,)) -> Any:
    splats.cut_index, splats.cut_normals = np.asarray(rows), np.reshape(np.asarray(normals, float), (-1, 3))
    return splats


def left(along: Any) -> Any:
    """g of n.w, as the pages have it."""
    return (1 + np.exp(-4)) / (1 + np.exp(-4 - np.asarray(along, float)))


# --- by hand ---


def test_a_kernel_is_multiplied_by_what_the_cut_leaves_there():
    """Large on the screen, so that the low-pass filter is next to nothing: 60 px to a standard deviation."""
    camera, shape = make_camera(f=600.0), ([0, 0, 2], (0.2, 0.4, 0.3))
    normal = np.array([3.0, -2.0, 7.0])
    splats = with_cuts(make_splats(*shape, dog=[0]), normal)
    p, whole = (reference.project(s, camera) for s in (splats, make_splats(*shape, dog=[0])))
    w = np.array([[0, 0], [1, 0], [-1, 0], [-4 / 3, 0], [0, 1], [0, 2], [-2, 1]])
    x, y = (p.means2d[0] + w * [60, 132]).T
    expected = left(w @ normal[:2])
    assert expected[0] == 1 and expected[2] < 0.75 and abs(expected[3] - (1 + np.exp(-4)) / 2) < 1e-12
    for cut, uncut in zip(kernels(p, 0, x, y), kernels(whole, 0, x, y), strict=True):
        np.testing.assert_allclose(cut, expected * uncut, rtol=2e-3)


def test_the_low_pass_filter_makes_cuts_of_tiny_primitives_gentle():
    """V is s = .3 px wide: w = s d / (s^2 + .3)."""
    splats = with_cuts(make_splats([0, 0, 2], 0.01), (2, 5, 9))
    (cut,) = reference.project(splats, make_camera(f=60.0)).cuts
    np.testing.assert_allclose(cut, [2 * 0.3 / (0.3**2 + 0.3), 5 * 0.33 / (0.33**2 + 0.3)], rtol=1e-12)


def test_a_pixel_sees_the_cut_at_the_mean_of_what_lies_behind_it():
    """Samples of a turned primitive, blurred by the filter: the regression of n.w on the place in the image."""
    quat = axis_rotation([0.3, -0.5, 0.8], 1.1)[1]
    normal = np.array([1.0, -2.0, 0.7])
    splats = with_cuts(make_splats([0.2, -0.1, 3], (0.2, 0.1, 0.3), quats=quat), normal)
    camera = tilted_camera(f=20.0)
    p, R = reference.project(splats, camera), reference.rotations(splats.quats)[0]
    w = np.random.default_rng(0).normal(size=(4_000_000, 3))
    w = np.concatenate([w, -w])
    offsets = w * 1e-3 * np.exp(splats.log_scales[0]) @ R.T  # so near that the projection is linear
    d = (camera.project(splats.means[0] + offsets)[0] - p.means2d[0]) / 1e-3
    d += np.sqrt(reference.LOW_PASS) * np.random.default_rng(2).normal(size=d.shape)
    measured = np.linalg.lstsq(d, w @ normal, rcond=None)[0]
    np.testing.assert_allclose(measured, p.cuts[0], atol=2e-3 * np.abs(p.cuts).max())


def test_a_cut_along_the_line_of_sight_is_not_seen():
    splats = with_cuts(make_splats([0, 0, 2], (0.2, 0.4, 0.3)), (0, 0, 50))
    camera = make_camera(f=60.0)
    image, whole = (reference.render(s, camera)[0] for s in (splats, make_splats([0, 0, 2], (0.2, 0.4, 0.3))))
    np.testing.assert_array_equal(image, whole)


def test_what_is_beyond_a_steep_cut_is_gone_and_the_rest_is_whole():
    camera, shape = make_camera(f=60.0), ([0, 0, 2], 0.3, 0.9)
    image, whole = (reference.render(s, camera)[0][24, :, 0]
                    for s in (with_cuts(make_splats(*shape), (400, 0, 0)), make_splats(*shape)))  # fmt: skip
    assert not image[:31].any() and whole[28:31].min() > 0.5
    np.testing.assert_allclose(image[33:], np.minimum(0.99, left(np.inf) * whole[33:]), rtol=1e-9)


def test_lists_hold_what_a_cut_makes_a_little_more_opaque():
    """Alpha just below the cutoff at the centre, and above it towards the normal."""
    splats = with_cuts(make_splats([0, 0, 2], 5.0, 0.99 / 255), (40, 0, 0))
    camera = make_camera(f=60.0)
    p = reference.project(splats, camera)
    assert p.extents.min() > 0 and reference.render(splats, camera)[0].max() > 1 / 255
    np.testing.assert_allclose(render_tiled(splats, camera).image, reference.render(splats, camera)[0], rtol=1e-12)
    rays = meet(splats, np.zeros((1, 3)), np.array([[0.3, 0, 1]]))
    assert rays.alphas[0, 0] > 1 / 255


# --- images ---


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("dog_share", [0, 0.5])
@pytest.mark.parametrize("choices", MODES)
def test_the_tiled_twin_shows_what_the_plain_one_does(dog_share, smooth, choices):
    splats = random_splats(60, seed=1, dog_share=dog_share, slope_share=0.4, cut_share=0.6)
    camera = tilted_camera(53, 37)
    image, T, _ = reference.render(splats, camera, BACKGROUND, smooth=smooth, **choices)
    ours = render_tiled(splats, camera, BACKGROUND, **choices, **(SMOOTH if smooth else {}))
    np.testing.assert_allclose(ours.image, image, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(ours.T, T, rtol=1e-12, atol=1e-12)


def test_cuts_of_zero_change_nothing_and_others_only_pixels_of_their_primitives():
    splats, camera = rounded(random_splats(20, seed=1)), tilted_camera(53, 37)
    whole = render_tiled(splats, camera)
    zero = replace(splats, cut_index=np.arange(20), cut_normals=np.zeros((20, 3)))
    np.testing.assert_allclose(render_tiled(zero, camera).image, whole.image, atol=1e-14)
    some = replace(splats, cut_index=[3, 7], cut_normals=np.full((2, 3), -5))
    changed = render_tiled(some, camera)
    footprints = [reference_score.weights(s, camera)[0][[3, 7]] for s in (splats, some)]
    elsewhere = ~np.any(footprints, axis=(0, 1))
    assert np.abs(changed.T - whole.T).max() > 0.01 and elsewhere.any()
    np.testing.assert_array_equal(changed.image[elsewhere], whole.image[elsewhere])


def test_a_primitive_whose_cut_is_not_finite_is_not_visible():
    splats = random_splats(5, cut_share=1)
    splats.cut_normals[2, 1], splats.cut_normals[3, 0] = np.nan, np.inf
    np.testing.assert_array_equal(reference.project(splats, make_camera()).visible, [True, True, False, False, True])


# --- gradients ---


def assert_gradients_equal(got: dict, expected: dict, rtol=1e-6):
    assert tuple(got) == tuple(expected)
    for name, values in expected.items():
        atol = 0.1 * rtol * np.abs(values).max(initial=0)
        np.testing.assert_allclose(got[name], values, rtol=rtol, atol=atol, err_msg=name)


@pytest.mark.parametrize("choices", MODES)
@pytest.mark.parametrize("dog_share", [0, 0.5])
@pytest.mark.parametrize("slope_share", [0, 0.5])
@pytest.mark.parametrize("cut_share", [0.5, 1])
def test_gradients_of_every_parameter_equal_differences(dog_share, slope_share, cut_share, choices):
    splats = random_splats(6, seed=5, degree=1, dog_share=dog_share, slope_share=slope_share, cut_share=cut_share)
    assert (len(splats.cut_index) == 6) == (cut_share == 1) and len(splats.cut_index) > 1
    expected = reference.loss_gradients(splats, SMALL, ADJOINT, background=BACKGROUND, **choices)
    got = gradients_tiled(splats, SMALL, ADJOINT, BACKGROUND, **choices, **SMOOTH)
    slopes = ("color_slopes",) if slope_share else ()
    assert tuple(got) == (*RAW_PARAMETERS, *slopes, "cut_normals")
    assert all(np.abs(values).max() > 1e-3 for values in got.values() if values.size)
    assert_gradients_equal(got, expected)


@pytest.mark.parametrize("seed", [6, 7])
def test_gradients_with_cutoffs_and_at_limits_equal_differences(seed):
    splats = random_splats(10, seed=seed, degree=1, cut_share=1)
    splats.logit_opacities[:2] = 8  # saturated but for where they are cut off
    splats.log_scales[:2] = 1
    splats.means[4, 0] = 9  # seen from the side, where the linearisation is clamped
    splats.log_scales[4] = 1
    expected = reference.loss_gradients(splats, SMALL, ADJOINT, background=BACKGROUND, smooth=False, eps=1e-6)
    assert expected["cut_normals"][:2].any(1).all()
    assert_gradients_equal(gradients_tiled(splats, SMALL, ADJOINT, BACKGROUND), expected, rtol=1e-5)


def test_primitives_that_are_not_seen_have_no_gradient():
    splats = random_splats(9, seed=8, cut_share=0.7)
    got = gradients_tiled(splats, SMALL, ADJOINT, near_clip=2.5)
    seen = reference.project(splats, SMALL, near_clip=2.5).visible[splats.cut_index]
    assert 0 < seen.sum() < len(seen)
    assert got["cut_normals"][seen].any(1).all() and not got["cut_normals"][~seen].any()


def test_a_mixed_model_has_gradients_of_all_groups():
    splats = replace(rounded(random_splats(6, seed=3)).with_sh_degrees(np.arange(6) % 3),
                     slope_index=[1, 2], color_slopes=np.ones((2, 3, 3)) / 3, cut_index=[2, 3, 5],
                     cut_normals=np.ones((3, 3)))  # fmt: skip
    expected = reference.loss_gradients(splats, SMALL, ADJOINT)
    got = gradients_tiled(splats, SMALL, ADJOINT, **SMOOTH)
    assert tuple(got) == (*RAW_PARAMETERS, "color_slopes", "cut_normals", "sh1_coeffs", "sh2_coeffs")
    assert_gradients_equal(got, expected)


# --- scores and rays ---


def test_a_footprint_is_what_the_picture_gains_with_the_primitive():
    """Of one that hides nothing: its alpha times its colour less that of the background, at each pixel."""
    splats, camera = with_cuts(make_splats([0, 0, 2], 0.3, 0.6), (3, -5, 1)), make_camera(20, 16, 20.0)
    footprint = reference_score.footprints(splats, camera, BACKGROUND)[0]
    with_it = reference.render(splats, camera, BACKGROUND)[0] - BACKGROUND
    alpha = reference_score.weights(splats, camera)[0][0]
    np.testing.assert_allclose(footprint * alpha, 0.6 * with_it.sum(-1), atol=1e-12)
    assert alpha.max() > 0.5


def test_a_ray_sees_the_cut_at_the_point_where_the_primary_is_largest():
    quat = axis_rotation([0.3, -0.5, 0.8], 1.1)[1]
    shape: Any = [[0.2, -0.1, 3], [0, 0, 6]], (0.8, 0.4, 1.2)
    normals = np.array([[2, -1, 3], [-4, 1, 2.0]])
    splats = with_cuts(make_splats(*shape, opacities=0.9, quats=quat, dog=[1]), normals, [0, 1])
    origins, directions = np.array([[0, 0, 0], [0.5, 0.1, 1]]), np.array([[0.1, 0, 1], [-0.1, -0.1, 2]])
    alphas = meet(splats, origins, directions, smooth=True).alphas
    whole = meet(make_splats(*shape, opacities=0.9, quats=quat, dog=[1]), origins, directions, smooth=True).alphas
    R, scales, along = reference.rotations(splats.quats), np.exp(splats.log_scales), np.linspace(0, 12, 600_001)
    for ray in range(2):
        points = origins[ray] + along[:, None] * directions[ray]
        for i in range(2):
            w = (points - splats.means[i]) @ R[i] / scales[i]
            nearest = w[(w**2).sum(1).argmin()]
            expected = left(nearest @ normals[i])
            assert abs(whole[ray, i]) > 0.05 and expected != 1
            np.testing.assert_allclose(alphas[ray, i], expected * whole[ray, i], rtol=1e-3)


def test_a_ray_sees_what_a_pixel_does_where_the_primitive_is_small_and_the_filter_smaller():
    camera = make_camera(20, 16, 4000.0)
    splats = with_cuts(make_splats([0, 0, 2], (0.002, 0.003, 0.001), 0.6), (3, 5, -4))
    image = reference.render(splats, camera, smooth=True)[0]
    x, y = reference.pixel_centres(0, 0, 20, 16)
    directions = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], -1)
    colors, _ = gather(meet(splats, np.zeros((len(x), 3)), directions, smooth=True), smooth=True)
    np.testing.assert_allclose(colors.reshape(image.shape), image, atol=0.02 * np.ptp(image))
