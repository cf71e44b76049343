"""Maps that are no similarity: exact kernels, the nearest colours, and pictures that a camera could have taken."""

from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.scene.cameras import Camera, affine
from mi_dogsplat.scene.linear_map import mapped_factors, mapped_kernels, sh_projection
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.transform import mean_scale, sh_rotation, transformed
from splat_scenes import axis_rotation, image_of, random_splats, rasterized, rounded, tilted_camera

ROTATION = axis_rotation([1, -2, 0.7], 2.1)[0]
SHEAR = np.array([[1.2, 0.5, 0], [0, 0.7, -0.3], [0.1, 0, 2.0]])
MIRROR = np.eye(3) - 2 * np.outer([0.6, 0, 0.8], [0.6, 0, 0.8])


def displaced(linear: np.ndarray) -> np.ndarray:
    return affine(linear, (0.4, -0.3, 0.2))


def covariances(quats: np.ndarray, scales: np.ndarray) -> np.ndarray:
    axes = reference.rotations(quats.astype(np.float64)) * scales[:, None]
    return axes @ axes.swapaxes(1, 2)


def directions(n: int) -> np.ndarray:
    found = np.random.default_rng(5).normal(size=(n, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


@pytest.mark.parametrize("linear", [SHEAR, -SHEAR, np.diag([1.0, 1, 3]), 1.7 * MIRROR])
def test_covariances_are_those_of_the_map_in_float64(linear):
    splats = rounded(random_splats(50))
    splats.log_scales[:5, 1] = -12  # flat ones
    got = transformed(splats, displaced(linear))
    before, after = (covariances(s.quats, np.exp(s.log_scales.astype(np.float64))) for s in (splats, got))
    expected = linear @ before @ linear.T
    np.testing.assert_allclose(after, expected, atol=2e-6 * abs(expected).max(axis=(1, 2)).max())
    np.testing.assert_allclose(got.means, splats.means @ linear.T + (0.4, -0.3, 0.2), atol=1e-5)
    np.testing.assert_array_equal(got.logit_opacities, splats.logit_opacities)
    np.testing.assert_array_equal(got.dog_logit_opacities, splats.dog_logit_opacities)


@pytest.mark.parametrize("degree", [0, 3])
def test_a_mirror_image_is_what_a_mirrored_camera_saw(degree):
    """The camera behind the mirror, whose picture is the other way round: both lobes and all bands of colour."""
    splats, camera = rounded(random_splats(60, degree=degree)), tilted_camera(cx=28.0)
    matrix = displaced(1.3 * MIRROR)
    w2c = np.diag([-1.3, 1.3, 1.3, 1]) @ camera.w2c @ np.linalg.inv(matrix)
    behind = Camera(w2c, camera.fx, camera.fy, camera.width - camera.cx, camera.cy, camera.width, camera.height)
    before, after = image_of(rasterized(splats, camera), camera), image_of(
        rasterized(transformed(splats, matrix), behind), behind)  # fmt: skip
    assert before.max() > 0.3 and np.abs(before - before[:, ::-1]).mean() > 0.01
    assert np.abs(after[:, ::-1] - before).mean() < 2e-5


def test_a_model_that_is_stretched_across_the_view_is_what_a_longer_lens_saw():
    """x times 1.6 before a camera and a focal length 1.6 times as long are one picture, DoG with equal F included."""
    splats, camera = rounded(random_splats(60, degree=0)), tilted_camera()
    splats.dog_log_scales[:] = splats.dog_log_scales[:, :1]
    matrix = np.linalg.inv(camera.w2c) @ np.diag([1.6, 1, 1, 1]) @ camera.w2c
    longer = Camera(camera.w2c, 1.6 * camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
    expected = image_of(rasterized(splats, longer), longer)
    got = image_of(rasterized(transformed(splats, matrix), camera), camera)
    assert np.abs(expected - image_of(rasterized(splats, camera), camera)).mean() > 0.01
    assert np.abs(got - expected).mean() < 2e-5


@pytest.mark.parametrize("linear", [SHEAR, MIRROR, np.diag([1.0, 1, -3])])
def test_equal_factors_of_dog_are_kept_by_any_map(linear):
    splats = rounded(random_splats(40))
    splats.dog_log_scales[:] = splats.dog_log_scales[:, :1]
    got = transformed(splats, displaced(linear))
    np.testing.assert_allclose(got.dog_log_scales, splats.dog_log_scales, atol=2e-6)


def test_factors_along_the_axes_of_a_stretch_move_with_them():
    splats = rounded(random_splats(40))
    splats.quats[:] = 0, 0, 0, 1
    splats.log_scales[:] = np.log([0.1, 0.2, 0.3])
    got = transformed(splats, displaced(np.diag([1.0, 9, 1])))  # 0.1, 1.8, 0.3: in another order
    pseudo, expected = (
        covariances(s.quats[s.dog_index], np.exp(s.log_scales[s.dog_index] + s.dog_log_scales)) for s in (got, splats)
    )
    expected[:, 1] *= 9
    expected[:, :, 1] *= 9
    np.testing.assert_allclose(pseudo, expected, rtol=1e-5, atol=1e-7)


def test_other_factors_are_the_nearest_that_a_dog_primitive_can_have():
    """No step away from them brings the pseudo-Gaussian nearer, by the Kullback-Leibler divergence."""
    rng = np.random.default_rng(0)
    quats, scales, factors = rng.normal(size=(30, 4)), rng.uniform(0.1, 1, (30, 3)), rng.uniform(0.3, 3, (30, 3))
    after = mapped_kernels(SHEAR, quats, scales)
    found = mapped_factors(SHEAR, (quats, scales), after, factors)
    axes = reference.rotations(after[0])
    true = axes.swapaxes(1, 2) @ SHEAR @ covariances(quats, factors * scales) @ SHEAR.T @ axes
    assert abs(true[:, 0, 1]).max() > 0.05  # not along the axes, or there would be nothing to choose

    def divergence(tried: np.ndarray) -> np.ndarray:
        variances = (tried * after[1]) ** 2
        return (np.diagonal(true, axis1=1, axis2=2) / variances + np.log(variances)).sum(axis=1)

    for axis in range(3):
        for step in (0.99, 1.01):
            assert (divergence(found * np.where(np.arange(3) == axis, step, 1)) > divergence(found)).all()


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_colours_are_the_nearest_of_their_degree(degree):
    """Oracle: least squares over many random directions, which have no quadrature."""
    d = directions(60_000)
    back = d @ np.linalg.inv(SHEAR).T
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    got = sh_projection(SHEAR, degree)
    expected = np.linalg.lstsq(reference.sh_basis(d, degree), reference.sh_basis(back, degree), rcond=None)[0]
    np.testing.assert_allclose(got, expected, atol=0.02)
    k = degree**2
    np.testing.assert_allclose(got[:k, :k], sh_projection(SHEAR, degree - 1), atol=1e-12)
    np.testing.assert_allclose(got[:, 0], np.eye(degree * (degree + 2) + 1)[0], atol=1e-12)  # a constant stays


@pytest.mark.parametrize("linear", [0.3 * ROTATION, 2 * MIRROR, -np.eye(3)])
def test_of_similarities_the_projection_is_the_turn(linear):
    isometry = linear / mean_scale(displaced(linear))
    np.testing.assert_allclose(sh_projection(linear, 3), sh_rotation(isometry, 3), atol=1e-12)
    d, coefficients = directions(50), np.random.default_rng(0).normal(size=16)
    turned = reference.sh_basis(d @ isometry.T, 3) @ (sh_rotation(isometry, 3) @ coefficients)
    np.testing.assert_allclose(turned, reference.sh_basis(d, 3) @ coefficients, atol=1e-12)


def test_degrees_of_single_primitives_are_those_of_the_padded_model():
    mixed = rounded(random_splats(40)).with_sh_degrees(np.arange(40) % 4)
    got, padded = transformed(mixed, displaced(SHEAR)), transformed(mixed.uniform_sh(), displaced(SHEAR))
    for degree in range(4):
        rows = np.flatnonzero(mixed.sh_degrees == degree)
        k = (degree + 1) ** 2
        own = got.uniform_sh().sh_coeffs[rows]
        np.testing.assert_allclose(own[:, :k], padded.sh_coeffs[rows, :k], atol=1e-5)
        assert not own[:, k:].any()


def test_a_primitive_that_is_not_finite_spoils_no_other():
    splats = rounded(random_splats(20))
    expected = transformed(splats, displaced(SHEAR))
    splats.log_scales[3] = np.nan
    got = transformed(splats, displaced(SHEAR))
    assert np.isnan(got.log_scales[3]).all()
    others = np.arange(20) != 3
    np.testing.assert_array_equal(got.log_scales[others], expected.log_scales[others])
    assert transformed(Splats.empty(2), displaced(SHEAR)).n_splats == 0


@pytest.mark.parametrize("linear", [
    np.diag([1.0, 1, 0]), np.zeros((3, 3)), np.diag([1, 1, np.nan]), np.diag([1e8, 1, 1]),
])  # fmt: skip
def test_what_flattens_is_refused(linear: Any):
    with pytest.raises(ValueError, match="cannot be flattened"):
        transformed(rounded(random_splats(3)), displaced(linear))
