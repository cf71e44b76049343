"""The float64 reference against closed forms, so that it may serve as the oracle for the engine."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.scene.splats import Splats
from splat_scenes import C0, axis_rotation, logit, make_camera, make_splats, random_splats

# Spherical harmonics and rotations

def test_sh_basis_is_orthonormal_on_the_sphere():
    z, weights = np.polynomial.legendre.leggauss(8)  # exact up to degree 15 in z
    phi = 2 * np.pi * np.arange(16) / 16
    r = np.sqrt(1 - z**2)[:, None]
    dirs = np.stack([r * np.cos(phi), r * np.sin(phi), z[:, None] + 0 * phi], axis=-1).reshape(-1, 3)
    basis = reference.sh_basis(dirs, 3)
    gram = (basis * np.repeat(weights * 2 * np.pi / 16, 16)[:, None]).T @ basis
    np.testing.assert_allclose(gram, np.eye(16), atol=1e-13)


def test_sh_basis_has_the_signs_and_the_order_of_3dgs():
    x, y, z, d = reference.sh_basis(np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], np.ones(3) / np.sqrt(3)]), 3)
    np.testing.assert_allclose(x[:4], [C0, 0, 0, -0.4886025119029199])
    np.testing.assert_allclose(y[:4], [C0, -0.4886025119029199, 0, 0])
    np.testing.assert_allclose(z[:4], [C0, 0, 0.4886025119029199, 0])
    c = 1.0925484305920792 / 3
    np.testing.assert_allclose(d[4:9], [c, -c, 0, -c, 0], atol=1e-15)
    np.testing.assert_allclose(z[[6, 12]], [2 * 0.31539156525252005, 2 * 0.3731763325901154])
    np.testing.assert_allclose(x[[8, 13, 15]], [0.5462742152960396, 0.4570457994644658, -0.5900435899266435])
    np.testing.assert_allclose(y[[8, 9, 11]], [-0.5462742152960396, 0.5900435899266435, 0.4570457994644658])
    np.testing.assert_allclose(d[10], 2.890611442640554 / 3**1.5)
    third = reference.sh_basis(np.array([[np.sqrt(0.5), 0, np.sqrt(0.5)]]), 3)[0]
    np.testing.assert_allclose(third[14], 1.445305721320277 * 0.5**1.5)


def test_a_lower_sh_degree_uses_the_leading_coefficients_only_and_a_higher_one_is_an_error():
    splats, camera = random_splats(degree=2), make_camera()
    expected = reference.project(splats, camera, sh_degree=1).colors
    splats.sh_coeffs = splats.sh_coeffs[:, :4]
    np.testing.assert_array_equal(reference.project(splats, camera).colors, expected)
    with pytest.raises(ValueError, match="sh_degree is 2, the splats have 1"):
        reference.project(splats, camera, sh_degree=2)


def test_quaternions_rotate_at_any_length_and_zero_is_the_identity():
    R, quat = axis_rotation([1, -2, 0.5], 1.1)
    matrices = reference.rotations(np.array([quat, -3 * quat, 1e-3 * quat, [0, 0, 0, 0]]))
    np.testing.assert_allclose(matrices, [R, R, R, np.eye(3)], atol=1e-14)


# Projection

def test_one_isotropic_gaussian_on_the_axis_has_its_closed_form_at_the_pixel_centres():
    camera = make_camera(33, 21, f=50)
    image, T, depth = reference.render(make_splats([0, 0, 2], 0.2, 0.7, (0.2, 0.5, 1)), camera)
    dx, dy = np.arange(33) + 0.5 - 16.5, (np.arange(21) + 0.5 - 10.5)[:, None]
    alpha = 0.7 * np.exp(-0.5 * (dx**2 / (5.0**2 + 0.3) + dy**2 / (5.5**2 + 0.3)))
    alpha[alpha < 1 / 255] = 0
    assert (alpha == 0).any()
    np.testing.assert_allclose(image, alpha[..., None] * [0.2, 0.5, 1], atol=1e-14)
    np.testing.assert_allclose(T, 1 - alpha, atol=1e-14)
    np.testing.assert_allclose(depth, 2 * alpha, atol=1e-14)


@pytest.mark.parametrize("mean", [(0.3, -0.4, 2), (9, 0.1, 2), (-9, 7, 2), (-0.1, -9, 2)])
def test_cov2d_propagates_the_covariance_through_the_projection_clamped_beyond_the_image(mean):
    camera = make_camera(cx=20, cy=30)
    scales = np.array([0.1, 0.2, 0.4])
    R, quat = axis_rotation([1, 2, 3], 0.8)
    p = reference.project(make_splats(mean, scales, quats=quat), camera)
    # J by differences, at the point whose projection is at most 15 % of the image outside of it
    pixel = np.array([camera.fx * mean[0], camera.fy * mean[1]]) / mean[2] + [camera.cx, camera.cy]
    low, high = np.array([-0.15 * 64, -0.15 * 48]), np.array([1.15 * 64, 1.15 * 48])
    x, y = (np.clip(pixel, low, high) - [camera.cx, camera.cy]) / [camera.fx, camera.fy] * mean[2]

    def pixel_of(q):
        return np.array([camera.fx * q[0] / q[2], camera.fy * q[1] / q[2]])

    point, h = np.array([x, y, mean[2]]), 1e-5 * np.eye(3)
    J = np.stack([(pixel_of(point + d) - pixel_of(point - d)) / 2e-5 for d in h], axis=1)
    cov = J @ R @ np.diag(scales**2) @ R.T @ J.T + 0.3 * np.eye(2)
    np.testing.assert_allclose(p.cov2d[0], [cov[0, 0], cov[0, 1], cov[1, 1]], rtol=1e-8)
    conic = np.linalg.inv(cov)
    np.testing.assert_allclose(p.conics[0], [conic[0, 0], conic[0, 1], conic[1, 1]], rtol=1e-7)
    np.testing.assert_allclose(p.means2d[0], pixel)  # the centre itself is not clamped


def test_the_conic_of_a_needle_stays_the_inverse_of_its_covariance():
    R, quat = axis_rotation([0, 0, 1], 0.7)
    p = reference.project(make_splats([0, 0, 1], [1e8, 1e-6, 1e-6], quats=quat), make_camera())
    xx, xy, yy = p.conics[0]
    along = R[:2, 0] * [60, 66]  # of the needle, in pixels
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    np.testing.assert_allclose(across @ [[xx, xy], [xy, yy]] @ across, 1 / 0.3, rtol=1e-6)


def test_rotating_the_world_and_the_camera_together_changes_nothing():
    splats, camera = random_splats(degree=0), make_camera()
    expected = reference.render(splats, camera)
    R, quat = axis_rotation([0.3, 1, -0.6], 2.0)
    shift = np.array([1.0, -2, 3])
    moved: Any = SimpleNamespace(**vars(splats))
    moved.means = splats.means @ R.T + shift
    (a, w), q = (quat[:3], quat[3]), splats.quats  # quaternion product quat * q
    vector = w * q[:, :3] + q[:, 3:] * a + np.cross(a, q[:, :3])
    moved.quats = np.column_stack([vector, w * q[:, 3] - q[:, :3] @ a])
    w2c = np.eye(4)
    w2c[:3, :3], w2c[:3, 3] = R.T, -R.T @ shift
    for ours, theirs in zip(reference.render(moved, make_camera(w2c=w2c)), expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-10)


def test_colour_depends_on_the_world_direction_from_the_camera_centre():
    R, _ = axis_rotation([0, 1, 0], 0.1)
    position = np.array([0.5, 0.2, -1])
    w2c = np.eye(4)
    w2c[:3, :3], w2c[:3, 3] = R, -R @ position
    splats = make_splats([0.2, 0.1, 3])
    splats.sh_coeffs = np.random.default_rng(1).normal(0, 0.1, (1, 4, 3))
    d = (splats.means[0] - position) / np.linalg.norm(splats.means[0] - position)
    sh = splats.sh_coeffs[0]
    expected = C0 * sh[0] + 0.4886025119029199 * (-d[1] * sh[1] + d[2] * sh[2] - d[0] * sh[3]) + 0.5
    np.testing.assert_allclose(reference.project(splats, make_camera(w2c=w2c)).colors[0], expected)


def test_shifting_the_principal_point_by_whole_pixels_shifts_the_image():
    splats = make_splats([[0, 0, 2], [0.2, 0.1, 3]], 0.05)
    image = reference.render(splats, make_camera())[0]
    shifted = reference.render(splats, make_camera(cx=32 + 7, cy=24 - 5))[0]
    np.testing.assert_allclose(shifted[:-5, 7:], image[5:, :-7], atol=1e-14)


def test_the_antialias_factor_keeps_the_integral_of_a_small_gaussian():
    splats, camera = make_splats([0, 0, 2], 0.02, 0.6, dog=[0]), make_camera(f=50)
    p = reference.project(splats, camera, antialiased=True)
    sx, sy = 0.5**2, 0.55**2
    expected = 0.6 * np.sqrt(sx * sy / ((sx + 0.3) * (sy + 0.3)))
    np.testing.assert_allclose(p.opacities, expected)
    sx, sy = 1.6**2 * sx, 1.6**2 * sy
    np.testing.assert_allclose(p.pseudo_opacities, 0.3 * np.sqrt(sx * sy / ((sx + 0.3) * (sy + 0.3))))
    splats.log_scales = np.full((1, 3), -40.0)
    np.testing.assert_allclose(reference.project(splats, camera, antialiased=True).opacities, 0.6 * 0.005)


def test_only_finite_primitives_in_front_of_the_near_plane_are_visible_and_the_rest_is_zero():
    means = [[0, 0, z] for z in (0.2, 0.21, -1, 0, 1, 1)] + [[np.nan, 0, 1]]
    splats = make_splats(means, dog=[0, 1, 4])
    splats.log_scales = splats.log_scales.copy()
    splats.log_scales[4], splats.log_scales[5] = 500, np.inf
    p = reference.project(splats, make_camera())
    np.testing.assert_array_equal(p.visible, [0, 1, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(p.dog, p.visible)
    for name, rows in vars(p).items():
        assert not rows[~p.visible].any(), name
    assert reference.project(splats, make_camera(), near_clip=0.1).visible[:2].all()
    assert np.isfinite(reference.render(splats, make_camera())[0]).all()


# Bounds and tiles

def test_extents_are_the_tight_box_of_the_level_sets():
    p = reference.project(random_splats(60), make_camera())
    assert p.dog.any() and not p.dog.all()
    angle = np.linspace(0, 2 * np.pi, 4001)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    for i in np.flatnonzero(p.visible).tolist():
        box = np.zeros(2)
        kernels = [(p.opacities[i], p.cov2d[i]), (p.pseudo_opacities[i], p.pseudo_cov2d[i])]
        for opacity, (xx, xy, yy) in kernels:
            if opacity > 1 / 255:
                radius = np.sqrt(2 * np.log(255 * opacity))
                ellipse = radius * np.linalg.cholesky([[xx, xy], [xy, yy]]) @ circle
                box = np.maximum(box, np.abs(ellipse).max(axis=1))
                level = np.maximum(*reference.kernels(p, i, *(p.means2d[i][:, None] + ellipse)))
                assert (level >= (1 - 1e-9) / 255).all()
        np.testing.assert_allclose(p.extents[i], box, rtol=1e-5)


def test_extents_are_zero_where_nothing_reaches_one_level():
    splats = make_splats([[0, 0, 2]] * 3, 0.1, [0.9 / 255, 0.9 / 255, 1.1 / 255], dog=[1])
    p = reference.project(splats, make_camera())
    assert not p.extents[:2].any() and (p.extents[2] > 0).all()


def test_the_union_of_both_level_sets_loses_no_visible_weight():
    p = reference.project(random_splats(60), make_camera())
    x, y = reference.pixel_centres(0, 0, 64, 48)
    negative = 0
    for i in np.flatnonzero(p.visible).tolist():
        G, G_p = reference.kernels(p, i, x, y)
        alpha = np.minimum(reference.MAX_ALPHA, G) - np.minimum(reference.MAX_ALPHA, G_p)
        seen = np.abs(alpha) >= 1 / 255
        assert (np.maximum(G, G_p)[seen] >= 1 / 255).all()
        assert (np.abs(x - p.means2d[i, 0])[seen] <= p.extents[i, 0]).all()
        assert (np.abs(y - p.means2d[i, 1])[seen] <= p.extents[i, 1]).all()
        negative += (alpha[seen] < 0).sum()
    assert negative > 100


@pytest.mark.parametrize("size", [(16, 16), (7, 5), (100, 100)])
@pytest.mark.parametrize("negative_transmittance", [True, False])
def test_tiles_and_composite_equal_the_direct_render_exactly(size, negative_transmittance):
    splats, camera, background = random_splats(80), make_camera(61, 43), (0.1, 0.4, 0.8)
    splats.logit_opacities = splats.logit_opacities + 2
    expected = reference.render(splats, camera, background, negative_transmittance=negative_transmittance)
    p = reference.project(splats, camera)
    lists = reference.tiles(p, 61, 43, *size)
    got = reference.composite(p, lists, 61, 43, background, negative_transmittance=negative_transmittance,
                              tile_width=size[0], tile_height=size[1])
    for ours, theirs in zip(got, expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert all((np.diff(p.depths[indices]) >= 0).all() for indices in lists)
    assert expected[1].min() < 1e-2


def test_a_small_primitive_is_listed_only_where_it_reaches_a_pixel_centre():
    p = reference.project(make_splats([0, 0, 2], 1e-4), make_camera())  # on the corner that four tiles share
    lists = reference.tiles(p, 64, 48, 32, 24)
    assert [list(indices) for indices in lists] == [[0]] * 4
    lists = reference.tiles(reference.project(make_splats([0.3, 0, 2], 1e-4), make_camera()), 64, 48, 32, 24)
    assert [list(indices) for indices in lists] == [[], [0], [], [0]]


def test_a_wrong_number_of_tile_lists_is_an_error():
    p = reference.project(random_splats(3), make_camera())
    with pytest.raises(ValueError, match="2 lists for 12 tiles"):
        reference.composite(p, [np.array([0])] * 2, 64, 48)


# Compositing

def test_no_primitives_give_the_background():
    splats, camera = make_splats(np.zeros((0, 3))), make_camera()
    image, T, depth = reference.render(splats, camera, (0.1, 0.2, 0.3))
    np.testing.assert_array_equal(image, np.broadcast_to([0.1, 0.2, 0.3], (48, 64, 3)))
    assert (T == 1).all() and (depth == 0).all()
    assert [len(i) for i in reference.tiles(reference.project(splats, camera), 64, 48)] == [0] * 12


def test_the_background_is_seen_through_the_transmittance():
    splats, camera, background = random_splats(), make_camera(), np.array([0.3, -0.2, 2])
    black, T, _ = reference.render(splats, camera)
    image, _, _ = reference.render(splats, camera, background)
    np.testing.assert_allclose(image, black + T[..., None] * background)


def test_nearer_primitives_come_first_and_equal_depths_keep_their_order():
    means, colors = [[0, 0, 3], [0, 0, 2], [0, 0, 2], [0, 0, 1]], np.eye(4)[:, :3]
    p = reference.project(make_splats(means, 0.5, colors=colors), make_camera())
    np.testing.assert_array_equal(reference.depth_order(p), [3, 1, 2, 0])
    tied = reference.project(make_splats([[0, 0, 2 + i % 2] for i in range(100)]), make_camera())
    np.testing.assert_array_equal(reference.depth_order(tied), np.r_[0:100:2, 1:100:2])
    # Large enough that the kernel is 1 at the middle: each takes half of what is left.
    image, T, _ = reference.render(make_splats(means, 1e4, colors=colors), make_camera())
    np.testing.assert_allclose(image[24, 32], [1 / 16, 1 / 4, 1 / 8], rtol=1e-6)
    np.testing.assert_allclose(T[24, 32], 1 / 16, rtol=1e-6)


def test_the_walk_stops_before_the_primitive_that_would_take_T_below_the_limit():
    # .9 each: T = .1, .01, .001, .0001 up to rounding, then the next one goes under.
    means = np.column_stack([np.zeros((6, 2)), np.arange(1, 7)])
    opacities = np.array([0.9, 0.9, 0.9, 0.89, 0.9, 0.01])
    splats, camera = make_splats(means, 1e5, opacities, np.arange(1, 7)[:, None] / 10.0), make_camera()
    image, T, depth = reference.render(splats, camera, (1, 1, 1))
    left = np.concatenate([[1], np.cumprod(1 - opacities)])
    np.testing.assert_allclose(T, left[4], rtol=1e-5)  # the fifth is left out, and the faint sixth with it
    weights = (opacities * left[:-1])[:4]
    np.testing.assert_allclose(image[..., 0], weights @ [0.1, 0.2, 0.3, 0.4] + left[4], rtol=1e-6)
    np.testing.assert_allclose(depth, weights @ [1, 2, 3, 4], rtol=1e-6)
    np.testing.assert_allclose(reference.render(splats, camera, smooth=True)[1], left[6], rtol=1e-5)


def test_behind_two_saturated_primitives_the_walk_stops_as_it_does_in_float32():
    assert (1 - reference.MAX_ALPHA) ** 2 < reference.MIN_T
    assert (1 - np.float32(reference.MAX_ALPHA)) ** 2 < np.float32(reference.MIN_T)
    _, T, _ = reference.render(make_splats([[0, 0, 1], [0, 0, 2]], 1e5, 0.999), make_camera())
    np.testing.assert_allclose(T, 0.01, rtol=1e-5)


def test_features_take_the_place_of_the_colours():
    splats, camera = random_splats(), make_camera()
    p = reference.project(splats, camera)
    lists = reference.tiles(p, 64, 48)
    features = np.column_stack([p.depths, np.ones(len(p.depths))])
    image, T, depth = reference.composite(p, lists, 64, 48, (0, 1), features=features)
    np.testing.assert_allclose(image[..., 0], depth)
    np.testing.assert_allclose(image[..., 1], 1)  # alpha T sums to 1 - T, negative alphas included


# Difference of Gaussians

def dog_profile(**dog):
    """alpha at 0, 1, 2, ... px from the centre of a DoG of sigma 200 px, where the low-pass is nothing."""
    camera = make_camera(1200, 1, f=400, cx=0.5, cy=0.5)
    image, _, _ = reference.render(make_splats([0, 0, 2], 1.0, 0.8, dog=[0], **dog), camera, smooth=True)
    return image[0, :, 0] / 0.8


def test_a_dog_at_its_start_has_half_the_peak_a_zero_at_1_51_and_its_minimum_at_2_32_sigma():
    profile, r = dog_profile(f_a=0.5, F=1.6), np.arange(1200) / 200
    np.testing.assert_allclose(profile[0], 0.5, atol=1e-6)
    zero = np.sqrt(2 * np.log(2) / (1 - 1 / 1.6**2))  # 1.508
    crossing = np.flatnonzero(np.diff(np.sign(profile)))[0]
    assert r[crossing] <= zero + 1e-4 and zero - 1e-4 <= r[crossing + 1]
    lowest = np.sqrt(2 * np.log(2 * 1.6**2) / (1 - 1 / 1.6**2))  # 2.315
    assert abs(r[profile.argmin()] - lowest) <= 1 / 200
    np.testing.assert_allclose(profile.min(), -0.107, atol=5e-4)


def test_a_dog_integrates_to_1_minus_f_a_F_squared():
    camera = make_camera(200, 200, f=40)
    splats = make_splats([0, 0, 2], 0.5, 0.1, dog=[0], F=(1.6, 1.6, 1.6))
    integral = reference.render(splats, camera, smooth=True)[0][..., 0].sum()
    det, wide = (10**2 + 0.3) * (11**2 + 0.3), (16**2 + 0.3) * (17.6**2 + 0.3)
    np.testing.assert_allclose(integral, 0.1 * 2 * np.pi * (np.sqrt(det) - 0.5 * np.sqrt(wide)), rtol=1e-6)
    np.testing.assert_allclose(integral / (0.1 * 2 * np.pi * 10 * 11), 1 - 0.5 * 1.6**2, rtol=1e-2)


def test_the_ring_raises_T_above_one_unless_negative_transmittance_is_off():
    splats, camera = make_splats([0, 0, 2], 0.2, 0.9, dog=[0]), make_camera()
    image, T, _ = reference.render(splats, camera)
    alpha = image[..., 0]
    assert T.max() > 1.05
    np.testing.assert_allclose(T, 1 - alpha)
    off, T_off, _ = reference.render(splats, camera, negative_transmittance=False)
    np.testing.assert_array_equal(off, image)
    np.testing.assert_allclose(T_off, 1 - np.maximum(alpha, 0))


def test_both_kernels_of_a_dog_are_limited_to_99_percent_each():
    splats = make_splats([0, 0, 2], 1e5, 0.9999, dog=[0], f_a=0.995)
    assert (reference.render(splats, make_camera(), smooth=True)[0] == 0).all()
    splats.dog_logit_opacities = logit([0.5])
    image = reference.render(splats, make_camera(), smooth=True)[0]
    np.testing.assert_allclose(image, 0.99 - 0.9999 / 2, rtol=1e-5)


def test_a_dog_with_a_vanishing_pseudo_gaussian_is_the_plain_gaussian():
    camera = make_camera()
    plain = reference.render(make_splats([0.1, 0, 2], [0.1, 0.2, 0.3]), camera)
    dog = reference.render(make_splats([0.1, 0, 2], [0.1, 0.2, 0.3], dog=[0], f_a=1e-300), camera)
    for ours, theirs in zip(dog, plain, strict=True):
        np.testing.assert_array_equal(ours, theirs)


# Derivatives

@pytest.fixture(scope="module")
def small_scene():
    splats = random_splats(4, seed=3, degree=1, dog_share=0)
    splats.means[:, 2] = [1.5, 2.2, 3, 4]  # no change of order under a perturbation
    splats.sh_coeffs[1, 0] = -3  # black: clamped
    splats.dog_index = np.array([0, 2], np.uint32)
    splats.dog_logit_opacities, splats.dog_log_scales = np.zeros(2), np.full((2, 3), 0.4)
    camera = make_camera(16, 12, f=12)
    return splats, camera, np.random.default_rng(0).normal(size=(12, 16, 3))


def test_gradients_have_the_shapes_of_the_parameters_and_do_not_depend_on_the_step(small_scene):
    splats, camera, adjoint = small_scene
    options = {"background": (0.2, 0.3, 0.4), "antialiased": True}
    gradients = reference.loss_gradients(splats, camera, adjoint, **options)
    coarse = reference.loss_gradients(splats, camera, adjoint, eps=1e-4, **options)
    assert tuple(gradients) == reference.RAW_PARAMETERS
    for key, gradient in gradients.items():
        assert gradient.shape == getattr(splats, key).shape and np.abs(gradient).max() > 1e-3, key
        np.testing.assert_allclose(gradient, coarse[key], atol=1e-5, rtol=1e-5, err_msg=key)


def test_gradients_of_colours_are_the_blending_weights_and_zero_where_clamped(small_scene):
    splats, camera, adjoint = small_scene
    gradient = reference.loss_gradients(splats, camera, adjoint, keys=["sh_coeffs"])["sh_coeffs"]
    p = reference.project(splats, camera)
    everything = [reference.depth_order(p)]
    for i in range(4):
        weight, _, _ = reference.composite(p, everything, 16, 12, [0], features=np.eye(4)[:, i:i + 1],
                                           smooth=True, tile_height=12)
        expected = C0 * (adjoint * weight).sum((0, 1)) * (p.colors[i] > 0)
        np.testing.assert_allclose(gradient[i, 0], expected, atol=1e-9)
    assert not gradient[1].any()


def test_gradients_obey_the_scale_freedom_of_quaternions(small_scene):
    splats, camera, adjoint = small_scene
    gradient = reference.loss_gradients(splats, camera, adjoint, keys=["quats"])["quats"]
    np.testing.assert_allclose((gradient * splats.quats).sum(1), 0, atol=1e-7)


def test_float32_splats_are_perturbed_in_float64(small_scene):
    splats, camera, adjoint = small_scene
    rounded = Splats(**vars(splats))
    exact: Any = SimpleNamespace(**{key: np.asarray(value, float) for key, value in vars(rounded).items()})
    keys = ["means", "dog_log_scales"]
    ours = reference.loss_gradients(rounded, camera, adjoint, keys=keys)
    theirs = reference.loss_gradients(exact, camera, adjoint, keys=keys)
    for key in keys:
        np.testing.assert_array_equal(ours[key], theirs[key])


def test_gradients_of_one_gaussian_are_the_closed_form():
    camera, adjoint = make_camera(16, 12, f=12, cx=7.3), np.random.default_rng(1).normal(size=(12, 16, 3))
    gradients = reference.loss_gradients(make_splats([0, 0, 2], 0.3, 0.6), camera, adjoint)
    dx, dy = np.arange(16) + 0.5 - 7.3, (np.arange(12) + 0.5 - 6)[:, None]
    xx, yy = 1.8**2 + 0.3, 1.98**2 + 0.3
    dL = adjoint.sum(2) * 0.6 * np.exp(-0.5 * (dx**2 / xx + dy**2 / yy))  # dL/d(log alpha)
    np.testing.assert_allclose(gradients["logit_opacities"], [0.4 * dL.sum()], rtol=1e-6)
    by_log_scale = [(dL * dx**2).sum() * 1.8**2 / xx**2, (dL * dy**2).sum() * 1.98**2 / yy**2]
    np.testing.assert_allclose(gradients["log_scales"][0, :2], by_log_scale, rtol=1e-6)
    by_mean = [6 * (dL * dx).sum() / xx, 6.6 * (dL * dy).sum() / yy]
    np.testing.assert_allclose(gradients["means"][0, :2], by_mean, rtol=1e-6)
    assert gradients["dog_log_scales"].shape == (0, 3)


def test_an_adjoint_of_another_shape_than_the_image_is_an_error(small_scene):
    splats, camera, adjoint = small_scene
    with pytest.raises(ValueError, match="adjoint has the shape"):
        reference.loss_gradients(splats, camera, adjoint[1:])
