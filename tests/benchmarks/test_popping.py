"""Popping where the formula knows it: two primitives that swap places."""

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats

from benchmarks.numerics import popping
from benchmarks.numerics.stiffness import primitive

CAMERA = Camera(np.eye(4), 50.0, 50.0, 24.0, 18.0, 48, 36)
COLORS = np.array([[0.9, 0.2, 0.1], [0.1, 0.3, 0.8]])


def pair(gap: float) -> Splats:
    """Two wide primitives beside each other, the right one farther by ``gap``: a turn of asin(5 gap) swaps them."""
    left, right = primitive(0.4, logit=0.5), primitive(0.4, logit=1.0)
    left.means[:], right.means[:] = (-0.1, 0, 3), (0.1, 0, 3 + gap)
    model = left.joined(right)
    model.sh_coeffs[:, 0] = (COLORS - 0.5) / 0.28209479
    return model


@pytest.mark.parametrize("kind", ["turn", "orbit"])
def test_two_primitives_that_swap_pop_by_the_product_of_their_alphas_and_the_difference_of_their_colours(kind):
    model, degrees = pair(1e-4), 0.1
    seen = popping.moved(CAMERA, kind, degrees, 3.0)
    alphas = [1 - reference.render(model.select([k]), seen)[1] for k in range(2)]
    expected = np.abs(np.multiply(*alphas)[..., None] * (COLORS[0] - COLORS[1]))
    measured = popping.measure(model, [CAMERA], kind, degrees, "depth")
    assert measured["popping"] == pytest.approx(expected.mean(), rel=1e-4) and measured["popping"] > 0.01
    assert measured["popping_largest"] == pytest.approx(expected.max(), rel=1e-4)
    assert measured["visible"] == pytest.approx(np.mean(expected.max(-1) >= popping.VISIBLE))
    before, after = (reference.render(model, camera)[0] for camera in (CAMERA, seen))
    whole = np.abs(after - before).mean()
    assert abs(whole - measured["popping"]) <= measured["smooth"] * 1.001


def test_a_turn_that_swaps_none_is_smooth_and_half_of_it_half_as_much():
    whole, half = (popping.measure(pair(1e-2), [CAMERA], "turn", degrees, "depth") for degrees in (0.1, 0.05))
    assert whole["popping_largest"] == half["popping_largest"] == 0
    assert whole["smooth"] == pytest.approx(2 * half["smooth"], rel=0.05)


def test_the_order_by_distance_does_not_change_when_the_camera_turns():
    assert popping.measure(pair(1e-4), [CAMERA], "turn", 1.0, "distance")["popping_largest"] == 0
    assert popping.measure(pair(1e-4), [CAMERA], "turn", 1.0, "depth")["popping_largest"] > 0.05


def test_its_pictures_are_those_of_the_reference():
    model = pair(0.5)
    image = popping.picture(upload(model), CAMERA, 0).image
    np.testing.assert_allclose(image, reference.render(model, CAMERA)[0], atol=1e-5)
