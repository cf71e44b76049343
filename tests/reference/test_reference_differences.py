"""The plain twin's derivatives by differences: shapes, closed forms, freedoms of scale."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.scene.splats import Splats
from splat_scenes import C0, make_camera, make_splats, random_splats


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
