"""Radiance of blended colours."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.plugin.transfer import emitted
from splat_scenes import to_linear


def twin(c: float, T: float) -> float:
    """``emitted`` of an sRGB colour in float64, for a coverage that is not zero."""
    a = 1 - T
    mean = min(max(c / a, 0), max(1, c))
    of_mean, of_rest = to_linear(np.array([mean, c - a * mean]))
    return a * of_mean + of_rest


@pytest.mark.parametrize("T", [0.05, 0.35, 0.8, 1.4])
@pytest.mark.parametrize("c", [-0.3, 0.1, 0.5, 0.9, 1.2, 3.0])
def test_radiance_of_sRGB_colours_and_its_derivatives_are_those_of_the_twin(c, T):
    at = [mi.Float(c), mi.Float(T)]
    dr.enable_grad(at)
    light: Any = emitted([at[0]] * 3, at[1], False)[1]
    assert light.numpy().item() == pytest.approx(twin(c, T), rel=1e-5, abs=1e-6)
    dr.backward(light)
    step = 1e-6
    by_c = (twin(c + step, T) - twin(c - step, T)) / (2 * step)
    by_T = (twin(c, T + step) - twin(c, T - step)) / (2 * step)
    found = [dr.grad(x).numpy().item() for x in at]
    np.testing.assert_allclose(found, [by_c, by_T], rtol=1e-3, atol=1e-5)
