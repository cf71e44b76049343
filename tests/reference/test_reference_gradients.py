"""The tiled float64 twin against the plain one, its gradients against differences."""

from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.reference import blending
from mi_dogsplat.reference.forward import RAW_PARAMETERS
from mi_dogsplat.reference.gradients import gradients_tiled, render_tiled
from splat_scenes import constant_layers, make_camera, make_splats, random_splats, tilted_camera
from tiled_twin import BACKGROUND, MODES, SMALL, SMOOTH, adjoint_of, assert_gradients_near, assert_images_equal


def assert_gradients_equal(got: dict, expected: dict, rtol=1e-6):
    assert tuple(got) == RAW_PARAMETERS
    assert_gradients_near(got, expected, rtol)


# Images

@pytest.mark.parametrize("choices", MODES)
@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("dog_share", [0, 0.5])
def test_the_image_and_T_are_those_of_the_plain_twin(dog_share, smooth, choices):
    splats = random_splats(60, seed=1, dog_share=dog_share)
    assert_images_equal(splats, tilted_camera(53, 37), smooth, **choices)


def test_the_image_of_2000_primitives_is_that_of_the_plain_twin():
    splats, camera = random_splats(2000, seed=2, degree=1), tilted_camera(64, 48)
    blocks = list(blending.blocks(reference.project(splats, camera), camera, 1 / 255))
    assert len(blocks) == 12 and 10 < min(len(b.splats) for b in blocks) < max(len(b.splats) for b in blocks) < 1500
    assert_images_equal(splats, camera)


def test_tiles_with_long_lists_are_halved_and_nothing_changes(monkeypatch):
    splats, adjoint = random_splats(300, seed=2, degree=1), adjoint_of(SMALL)
    whole = gradients_tiled(splats, SMALL, adjoint)
    monkeypatch.setattr(blending, "MAX_PAIRS", 1 << 12)
    heights = {b.dy.shape[1] for b in blending.blocks(reference.project(splats, SMALL), SMALL, 1 / 255)}
    assert max(heights) < 16 and len(heights) > 1
    assert_images_equal(splats, SMALL)
    assert_gradients_equal(gradients_tiled(splats, SMALL, adjoint), whole, rtol=1e-11)


def test_options_of_the_projection_are_passed_on():
    splats, camera = random_splats(30, seed=4), tilted_camera(30, 20)
    everything = assert_images_equal(splats, camera)
    choices: list[dict[str, Any]] = [{"near_clip": 2.5}, {"sh_degree": 1}]
    for choice in choices:
        assert np.abs(assert_images_equal(splats, camera, **choice).image - everything.image).max() > 1e-2


def test_a_model_without_visible_primitives_shows_the_background():
    splats, camera = make_splats([[0, 0, -2], [0, 0, 0.1]]), make_camera(20, 10)
    shown = render_tiled(splats, camera, BACKGROUND)
    np.testing.assert_array_equal(shown.image, np.broadcast_to(BACKGROUND, (10, 20, 3)))
    assert (shown.T == 1).all() and shown.max_T == 1
    for gradient in gradients_tiled(splats, camera, adjoint_of(camera)).values():
        assert not gradient.any()


# Transmittance

def test_the_largest_transmittance_is_that_between_negative_lobes_and_what_hides_them():
    splats, camera = constant_layers([-0.4, -0.3, 0.9, 0.9]), make_camera(20, 18)
    shown = assert_images_equal(splats, camera)
    np.testing.assert_allclose(shown.max_T, 1.4 * 1.3, rtol=1e-6)
    np.testing.assert_allclose(shown.T, 1.4 * 1.3 * 0.01, rtol=1e-5)
    np.testing.assert_allclose(render_tiled(splats, camera, **SMOOTH).max_T, 1.4 * 1.3, rtol=1e-6)
    np.testing.assert_allclose(render_tiled(constant_layers([-0.4, -0.3]), camera).max_T, 1.4 * 1.3, rtol=1e-6)
    assert render_tiled(splats, camera, negative_transmittance=False).max_T == 1


@pytest.mark.parametrize("alphas, blended", [([0.9, 0.9, 0.9, 0.89, 0.9, 0.01, -0.9], 4), ([-0.97] * 34 + [0.5], 30)],
                         ids=["opaque", "growing"])
def test_the_walk_ends_where_that_of_the_plain_twin_does(alphas, blended):
    splats, camera, adjoint = constant_layers(alphas), make_camera(10, 9), np.ones((9, 10, 3))
    shown = assert_images_equal(splats, camera)
    np.testing.assert_allclose(shown.T, np.prod(1 - np.array(alphas[:blended])), rtol=1e-4)
    got = gradients_tiled(splats, camera, adjoint, BACKGROUND)
    expected = reference.loss_gradients(splats, camera, adjoint, background=BACKGROUND, smooth=False,
                                        keys=["logit_opacities", "sh_coeffs"])
    for name, values in expected.items():
        assert values[:blended].all() and not values[blended:].any()
        np.testing.assert_allclose(got[name], values, rtol=1e-6, atol=1e-8 * np.abs(shown.image).sum())


def test_a_walk_that_has_ended_does_not_overflow_behind_its_end():
    assert_images_equal(constant_layers([-0.97] * 1100), make_camera(4, 3))


# Gradients

@pytest.mark.parametrize("choices", MODES)
@pytest.mark.parametrize("dog_share", [0, 0.5])
def test_gradients_of_every_parameter_equal_differences(dog_share, choices):
    splats = random_splats(6, seed=5, degree=1, dog_share=dog_share)
    expected = reference.loss_gradients(splats, SMALL, adjoint_of(SMALL), background=BACKGROUND, **choices)
    got = gradients_tiled(splats, SMALL, adjoint_of(SMALL), BACKGROUND, **choices, **SMOOTH)
    assert all(np.abs(values).max() > 1e-2 for values in got.values() if values.size)
    assert_gradients_equal(got, expected)


@pytest.mark.parametrize("seed", [6, 7])
def test_gradients_with_cutoffs_equal_differences_where_no_pixel_is_at_one(seed):
    splats = random_splats(10, seed=seed, degree=1)
    splats.logit_opacities[:2] = 8  # saturated
    splats.log_scales[:2] = 1
    splats.sh_coeffs[3, 0] = -5  # black: clamped
    i = splats.dog_index[-1]
    splats.logit_opacities[i] = splats.dog_logit_opacities[-1] = 7  # the pseudo-Gaussian is saturated too
    splats.log_scales[i], splats.dog_log_scales[-1] = -0.5, 0.7
    expected = reference.loss_gradients(splats, SMALL, adjoint_of(SMALL), background=BACKGROUND, smooth=False,
                                        eps=1e-6)
    assert not expected["sh_coeffs"][3].any()
    smooth = gradients_tiled(splats, SMALL, adjoint_of(SMALL), BACKGROUND, **SMOOTH)
    got = gradients_tiled(splats, SMALL, adjoint_of(SMALL), BACKGROUND)
    for name, values in got.items():
        assert np.abs(values - smooth[name]).max() > 1e-4 * np.abs(values).max(), f"no cutoff acts on {name}"
    assert_gradients_equal(got, expected, rtol=1e-5)


def test_gradients_beyond_the_clamp_of_the_linearisation_equal_differences():
    splats = random_splats(5, seed=2, degree=3)
    splats.means[:, :2] *= 3
    splats.log_scales += 1
    expected = reference.loss_gradients(splats, SMALL, adjoint_of(SMALL))
    assert_gradients_equal(gradients_tiled(splats, SMALL, adjoint_of(SMALL), **SMOOTH), expected)


def test_gradients_of_coefficients_beyond_sh_degree_and_of_primitives_before_the_near_plane_are_zero():
    splats = random_splats(6, seed=8, degree=3)
    choices: dict[str, Any] = {"sh_degree": 1, "near_clip": 2.5}
    got = gradients_tiled(splats, SMALL, adjoint_of(SMALL), **choices, **SMOOTH)
    seen = reference.project(splats, SMALL, **choices).visible
    assert 0 < seen.sum() < 6
    assert got["sh_coeffs"][seen, :4].any((1, 2)).all() and not got["sh_coeffs"][:, 4:].any()
    assert not got["means"][~seen].any()
    assert_gradients_equal(got, reference.loss_gradients(splats, SMALL, adjoint_of(SMALL), **choices))


def test_primitives_that_are_not_seen_have_no_gradient_and_change_no_other():
    splats = random_splats(9, seed=9, degree=1, dog_share=1)
    alone = gradients_tiled(splats, SMALL, adjoint_of(SMALL), BACKGROUND)
    more = random_splats(13, degree=1, dog_share=1)
    for name in RAW_PARAMETERS:
        setattr(more, name, np.concatenate([getattr(more, name)[:4], getattr(splats, name)]))
    more.means[0, 2], more.log_scales[1, 2] = -1, 1e3
    more.logit_opacities[2] = more.dog_logit_opacities[3] = np.nan
    got = gradients_tiled(more, SMALL, adjoint_of(SMALL), BACKGROUND)
    for name, values in alone.items():
        assert not got[name][:4].any(), name
        np.testing.assert_allclose(got[name][4:], values, rtol=1e-12, atol=1e-12)


def test_an_opacity_of_exactly_0_or_1_has_no_gradient():
    splats = make_splats([[0, 0, 2], [0.3, 0, 3]], 0.5, 0.5)
    splats.logit_opacities = np.array([np.inf, -np.inf])
    got = gradients_tiled(splats, SMALL, adjoint_of(SMALL), BACKGROUND)
    assert not got["logit_opacities"].any() and got["means"][0].all() and not got["means"][1].any()


def test_the_zero_quaternion_is_the_identity_without_a_gradient():
    splats = make_splats([0.1, 0, 2], (0.3, 0.2, 0.1), quats=(0, 0, 0, 0))
    identity = make_splats([0.1, 0, 2], (0.3, 0.2, 0.1), quats=(0, 0, 0, 1))
    got, expected = (gradients_tiled(s, SMALL, adjoint_of(SMALL)) for s in (splats, identity))
    assert not got.pop("quats").any() and expected.pop("quats").any()
    for name, values in expected.items():
        np.testing.assert_array_equal(got[name], values)


def test_an_adjoint_of_another_shape_than_the_image_is_an_error():
    with pytest.raises(ValueError, match=r"adjoint has the shape \(17, 20, 3\), the image \(18, 20, 3\)"):
        gradients_tiled(random_splats(2), SMALL, adjoint_of(SMALL)[1:])
