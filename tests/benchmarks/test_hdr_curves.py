"""The tone curves that are compared: 0 at black, increasing, with the slope of differences."""

from types import SimpleNamespace
from typing import Any, cast

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.arrays import array_types

from benchmarks.training.hdr import CURVES, LINE, ZOOM, _sheet


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_has_the_slope_of_differences(name):
    curve, x = CURVES[name], np.geomspace(0.05, 500, 60)
    fine, h = array_types().Double, 1e-6 * x
    differences = (curve(fine(x + h)).numpy() - curve(fine(x - h)).numpy()) / (2 * h)
    np.testing.assert_allclose(curve.slope(mi.Float(x)).numpy(), differences, rtol=2e-3)
    assert curve(mi.Float(0))[0] == 0 and (differences > 0).all()
    assert curve(mi.Float(1))[0] == pytest.approx(1, abs=1e-5)


def test_a_scene_that_fills_its_picture_is_shown_whole():
    image = np.full((12, 16, 3), 0.5, np.float32)
    truth = SimpleNamespace(test=[SimpleNamespace(image=image)], white=1.0)
    sheet = _sheet(cast(Any, truth), {"a": image})
    assert sheet.shape[0] == LINE + 2 * ZOOM * 12  # a row for the truth, and one for the model
    assert (sheet[LINE:, -ZOOM * 16 :] > 0.9).all()  # all of the brightest exposure, which is the last
