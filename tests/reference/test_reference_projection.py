"""The plain twin's spherical harmonics, projection, bounds and tile lists against closed forms."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.scene.cameras import affine
from splat_scenes import C0, axis_rotation, make_camera, make_splats, random_splats

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
    camera = make_camera(w2c=affine(R.T, -R.T @ shift))
    for ours, theirs in zip(reference.render(moved, camera), expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-10)


def test_colour_depends_on_the_world_direction_from_the_camera_centre():
    R, _ = axis_rotation([0, 1, 0], 0.1)
    position = np.array([0.5, 0.2, -1])
    w2c = affine(R, -R @ position)
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
        assert not (rows.swapaxes(0, 1) if name in ("cut", "cuts") else rows)[~p.visible].any(), name
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
