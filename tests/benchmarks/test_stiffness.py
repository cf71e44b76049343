"""The stiffness study: right where theory knows the answer, and the engine agrees."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.parameters import device_array, upload
from mi_dogsplat.engine.rasterize import RasterOptions, rasterize
from mi_dogsplat.reference.forward import render
from mi_dogsplat.scene.sh_basis import C0

from benchmarks.numerics import stiffness

SITUATIONS = {situation.case: situation for situation in stiffness.situations()}
PLAIN, NEEDLE = SITUATIONS["opacity logit 0"], SITUATIONS["needle 1:1000"]


def curvature(case: str, parameter: str) -> float:
    return stiffness.curvature_of(SITUATIONS[case].loss(parameter))[0]


def test_the_curvature_of_a_colour_is_that_of_its_weights():
    """colour = C0 SH + 0.5, so the loss is the mean of (α C0 x)² over pixels, a third of it per channel."""
    alpha = 1 - render(PLAIN.splats, stiffness.CAMERA, smooth=True)[1]
    expected = 2 * C0**2 * np.mean(alpha**2) / 3
    assert curvature("opacity logit 0", "SH constant") == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("true", "scale"), [(3e-18, 1.0), (7e4, 1e-4)])
def test_curvature_basin_and_limit_of_a_known_function(true, scale):
    """c s² (1 - cos(x / s)): within half of its parabola as far as 2.78 s."""

    def loss(x):
        return 2 * true * scale**2 * np.sin(x / scale / 2) ** 2

    measured, h = stiffness.curvature_of(loss)
    assert measured == pytest.approx(true, rel=1e-3)
    assert stiffness.basin_of(loss, measured, h) == pytest.approx(2.783 * scale, rel=1e-3)
    assert stiffness.descent_limit(loss, measured, 1e-3 * scale) == pytest.approx(2 / true, rel=1e-3)


def test_a_parabola_is_a_basin_without_end():
    assert stiffness.basin_of(lambda x: x * x, 2.0, 1.0) is None


@pytest.mark.parametrize(("rate", "curvature"), [(0.01, 1.0), (3.0, 1e-3), (0.1, 1e-16)])
def test_adam_is_that_of_the_library(rate, curvature):
    losses = stiffness.adam_losses(lambda x: 0.5 * curvature * x * x, rate, 1.0)
    adam = mi.ad.Adam(lr=rate, epsilon=stiffness.EPSILON, params={"x": mi.Float(1)})
    for expected in losses:
        dr.set_grad(adam["x"], curvature * dr.detach(adam["x"]))
        adam.step()
        assert float(adam["x"][0]) ** 2 == pytest.approx(expected, rel=1e-3, abs=1e-3)


CHECKED = [
    ("needle 1:10", "position across"), ("needle 1:1000", "position across"), ("needle 1:100000", "rotation"),
    ("needle 1:10", "short log-scale"), ("opacity logit 10", "logit opacity"), ("opacity logit 5", "position"),
    ("DoG, F and f_a at 1 - 1e-02", "DoG log F"), ("DoG, F and f_a at 1 - 1e-04", "DoG log F"),
    ("DoG, F 10, f_a 0.5", "DoG logit f_a"), ("SH", "SH degree 3"),
]  # fmt: skip


@pytest.mark.parametrize(("case", "parameter"), CHECKED)
def test_the_gradient_of_the_engine_near_the_optimum_is_curvature_times_distance(case, parameter):
    situation = SITUATIONS[case]
    field, index = situation.parameters[parameter]
    c, h = stiffness.curvature_of(situation.loss(parameter))
    basin = stiffness.basin_of(situation.loss(parameter), c, h)
    shift = 0.02 * (basin or 1.0)
    target = render(situation.splats, stiffness.CAMERA, stiffness.BACKGROUND, smooth=True)[0]
    options = RasterOptions(sh_degree=situation.splats.sh_degree, cutoffs=SMOOTH)
    gradients = []
    for x in (shift, -shift):  # their difference has no error of second order
        params = upload(situation.splats)
        values = np.array(getattr(situation.splats, field))
        values.flat[index] += x
        params[field] = device_array(values)
        dr.enable_grad(params[field])
        frame = rasterize(params, DeviceCamera.upload(stiffness.CAMERA), options)
        planes = [dr.fma(frame.T, grey, plane) for plane, grey in zip(frame.colors, stiffness.BACKGROUND, strict=True)]
        errors = [plane - device_array(target[..., k]) for k, plane in enumerate(planes)]
        loss: Any = sum(dr.mean(error * error) for error in errors) / 3
        dr.backward(loss)
        gradients.append(dr.grad(params[field]).numpy()[index])
    assert (gradients[0] - gradients[1]) / (2 * shift) == pytest.approx(c, rel=0.02)


def test_the_low_pass_filter_bounds_the_curvature_across_needles_and_flattens_that_of_their_width():
    across = [curvature(f"needle 1:{ratio}", "position across") for ratio in (10, 1000, 100000)]
    assert max(across) < 1.1 * min(across)
    width = [curvature(f"needle 1:{ratio}", "short log-scale") for ratio in (1000, 100000)]
    assert width[0] / width[1] == pytest.approx(1e8, rel=1e-2)  # the fourth power of the width


def test_saturated_opacities_are_flat_as_their_sigmoid_and_the_rest_of_the_primitive_is_not():
    flat = [curvature(f"opacity logit {logit}", "logit opacity") for logit in (10, 15)]
    assert flat[0] / flat[1] == pytest.approx(np.exp(10), rel=0.01)
    position = [curvature(f"opacity logit {logit}", "position") for logit in (10, 15)]
    assert position[0] == pytest.approx(position[1], rel=1e-3)


def test_near_degeneracy_all_of_a_pair_is_flat_but_its_factor_and_nothing_is_drawn():
    coarse, fine = (f"DoG, F and f_a at 1 - 1e-0{k}" for k in (4, 6))
    for parameter in ("DoG logit f_a", "logit opacity", "position", "log-scale"):
        assert curvature(coarse, parameter) / curvature(fine, parameter) == pytest.approx(1e4, rel=0.01)
    assert curvature(coarse, "DoG log F") == pytest.approx(curvature(fine, "DoG log F"), rel=0.01)
    drawn = [SITUATIONS[f"DoG, F and f_a at 1 - 1e-0{k}"].drawn() for k in range(1, 7)]
    assert drawn == [True, True, False, False, False, False]
    assert "never drawn" in stiffness.measure(SITUATIONS[fine], "position")["verdict"]


@pytest.mark.slow
def test_gradient_descent_bears_two_over_the_curvature_and_adam_keeps_within_the_basin():
    rows = stiffness.rows(NEEDLE) + stiffness.rows(PLAIN)
    for row in rows:
        assert row["gradient_descent_limit"] == pytest.approx(row["two_over_curvature"], rel=0.3)
        assert row["adam_over_basin"] < 0.2 and row["verdict"] == "Adam follows"
    stiff = {row["parameter"]: row["stiffness"] for row in rows[: len(NEEDLE.parameters)]}
    assert stiff["position across"] == 1 and stiff["short log-scale"] > 1e9


def test_adam_overshoots_with_short_quaternions_and_does_not_turn_long_ones():
    short, long = (
        stiffness.measure(SITUATIONS[f"needle 1:10, quaternion of length {length}"], "rotation")
        for length in ("0.001", "1000")
    )
    assert short["verdict"] == "Adam overshoots" and short["adam_over_basin"] > 10
    assert long["verdict"] == "Adam hardly moves" and long["adam_end"] > 0.95


def test_a_parameter_without_curvature_is_an_error():
    with pytest.raises(ArithmeticError, match="second derivative"):
        stiffness.curvature_of(lambda x: 0.0)
