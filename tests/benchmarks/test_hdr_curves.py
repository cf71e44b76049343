"""The tone curves that are compared: 0 at black, increasing, with the slope of differences."""

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.arrays import array_types

from benchmarks.training.hdr import CURVES


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_has_the_slope_of_differences(name):
    curve, x = CURVES[name], np.geomspace(0.05, 500, 60)
    fine, h = array_types().Double, 1e-6 * x
    differences = (curve(fine(x + h)).numpy() - curve(fine(x - h)).numpy()) / (2 * h)
    np.testing.assert_allclose(curve.slope(mi.Float(x)).numpy(), differences, rtol=2e-3)
    assert curve(mi.Float(0))[0] == 0 and (differences > 0).all()
    assert curve(mi.Float(1))[0] == pytest.approx(1, abs=1e-5)
