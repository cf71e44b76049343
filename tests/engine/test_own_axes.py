"""By how much a pixel tells how far along its own axes a primitive is seen: extreme ones against 60 digits."""

from decimal import Decimal, localcontext
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.own_axes import own_axes_per_pixel
from mi_dogsplat.engine.screen_kernels import LOW_PASS, MAX_AXIS

AXES = np.array([[30.0, -41.0, 12.0], [22.5, 17.0, -35.0]], np.float32)  # J W R: px to a unit of length
SCALES = {
    "round": (1, 1, 1),
    "needle": (1e-6, 1e-6, 1),
    "long needle": (1e-3, 1e-3, 1e3),
    "longest needle": (1e-4, 1e-4, 4e5),
    "thin disc": (1e-7, 1, 2),
    "large disc": (1e-3, 1e6, 1e6),
    "tiny": (1e-12, 2e-12, 3e-12),
    "a speck": (1e-30, 1e-30, 1e-30),
    "huge": (1e6, 2e6, 1.5e6),
    "of all sizes": (1e-12, 1, 1e6),
}


def exact(scales: np.ndarray) -> np.ndarray:
    """Sigma'^-1 V, [3, 2] by axis."""
    number = np.vectorize(Decimal, otypes=[object])
    with localcontext() as context:
        context.prec = 60
        V = number(AXES.astype(float)) * number(scales.astype(float))
        covariance = V @ V.T + Decimal(LOW_PASS) * np.eye(2, dtype=int)
        (xx, xy), (_, yy) = covariance
        inverse = np.array([[yy, -xy], [-xy, xx]]) / (xx * yy - xy * xy)
        return (inverse @ V).T.astype(float)


def engine(scales: np.ndarray, cut: np.ndarray | None = None) -> np.ndarray:
    axes = [[mi.Float(value) for value in row] for row in AXES.tolist()]
    given, in_range = ([mi.Float(s) for s in of.tolist()] for of in (scales, scales if cut is None else cut))
    return np.array([[to.numpy()[0] for to in pair] for pair in own_axes_per_pixel(axes, given, in_range)])


@pytest.mark.parametrize("name", SCALES)
def test_every_axis_is_right_to_float32(name):
    scales = np.array(SCALES[name], np.float32)
    got, expected = engine(scales), exact(scales)
    assert expected.any(1).all()
    lengths = np.linalg.norm(expected, axis=1)
    assert (np.linalg.norm(got - expected, axis=1) <= 2e-6 * lengths + 1e-6 * 1e-30).all()


def test_an_axis_that_was_out_of_range_tells_nothing_and_the_others_what_they_do():
    scales = np.array([0.5, 1e30, 0.3], np.float32)
    cut = np.minimum(scales, np.float32(MAX_AXIS) / np.abs(AXES).max(0))
    got, expected = engine(scales, cut), exact(cut)
    assert cut[1] < scales[1] and not got[1].any()
    np.testing.assert_allclose(got[[0, 2]], expected[[0, 2]], rtol=1e-5)


@pytest.mark.parametrize("name", SCALES)
def test_derivatives_are_finite(name):
    scales = [mi.Float(np.float32(s)) for s in SCALES[name]]
    axes = [[mi.Float(value) for value in row] for row in AXES.tolist()]
    dr.enable_grad(scales, axes)
    found: Any = sum(to for pair in own_axes_per_pixel(axes, scales, scales) for to in pair)
    dr.backward(found)
    assert all(dr.all(dr.isfinite(dr.grad(value))) for value in [*scales, *axes[0], *axes[1]])


@pytest.mark.parametrize("name", ["large disc", "huge"])
def test_where_the_low_pass_filter_is_nothing_twice_the_size_is_half_the_change_per_pixel(name):
    """Euler: the derivatives by the logarithms of the scales add up to minus the value."""
    log_scales = [mi.Float(np.log(s)) for s in SCALES[name]]
    dr.enable_grad(log_scales)
    axes, scales = [[mi.Float(value) for value in row] for row in AXES.tolist()], [dr.exp(s) for s in log_scales]
    values: Any = [to for pair in own_axes_per_pixel(axes, scales, scales)[1:] for to in pair]
    total: Any = sum(values)
    dr.backward(total)
    assert sum(dr.grad(s)[0] for s in log_scales) == pytest.approx(-total[0], rel=1e-3)
