"""The float64 twin of models whose primitives have SH degrees of their own."""

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.reference.forward import RAW_PARAMETERS
from mi_dogsplat.reference.gradients import gradients_tiled, render_tiled
from mi_dogsplat.scene.splats import Splats
from splat_scenes import random_splats, rounded, tilted_camera

CAMERA = tilted_camera(16, 12, f=14.0, cx=7.0, cy=6.5)
ADJOINT = np.random.default_rng(0).normal(size=(12, 16, 3))
GROUPS = ("sh1_coeffs", "sh2_coeffs", "sh3_coeffs")


def mixed(n=9, **settings) -> Splats:
    return rounded(random_splats(n, seed=3, **settings)).with_sh_degrees(np.arange(n) % 4)


@pytest.mark.parametrize("sh_degree", [None, 0, 1, 2, 3])
def test_the_picture_is_that_of_the_model_padded_with_zeros(sh_degree):
    for render in (reference.render, lambda *a, **k: vars(render_tiled(*a, **k)).values()):
        ours, padded = (render(s, CAMERA, sh_degree=sh_degree) for s in (mixed(), mixed().uniform_sh()))
        for a, b in zip(ours, padded, strict=True):
            np.testing.assert_array_equal(a, b)
    with pytest.raises(ValueError, match="sh_degree is 3, the splats have 2"):
        reference.project(mixed().with_sh_degrees(np.arange(9) % 3), CAMERA, sh_degree=3)


def test_a_primitive_whose_own_coefficients_are_not_finite_is_not_visible():
    model = mixed()
    model.sh2_coeffs[1, 7, 2] = np.nan
    broken = model.sh2_index[1]
    assert reference.project(mixed(), CAMERA).visible[broken] and not reference.project(model, CAMERA).visible[broken]
    assert reference.project(model, CAMERA, sh_degree=1).visible[broken]


@pytest.mark.parametrize("sh_degree", [None, 1])
def test_gradients_equal_differences(sh_degree):
    got = gradients_tiled(mixed(), CAMERA, ADJOINT, min_alpha=0, min_transmittance=0, sh_degree=sh_degree)
    expected = reference.loss_gradients(mixed(), CAMERA, ADJOINT, sh_degree=sh_degree)
    assert set(got) == set(expected) == {*RAW_PARAMETERS, *GROUPS}
    for name, values in expected.items():
        assert values.shape == getattr(mixed(), name).shape and values.any(), name
        np.testing.assert_allclose(got[name], values, rtol=1e-6, atol=1e-7 * np.abs(values).max(), err_msg=name)
