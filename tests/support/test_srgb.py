"""The sRGB curve at the ends of what float32 can say; its values are checked where pictures are."""

import numpy as np
import pytest
from mi_dogsplat.support.srgb import (
    displayed,
    linear_to_srgb,
    linear_to_srgb_log,
    srgb_log_to_linear,
    srgb_to_linear,
)

LARGEST = float(np.finfo(np.float32).max)


def test_what_float32_cannot_say_is_infinite_without_a_warning():
    assert srgb_to_linear([LARGEST, -LARGEST]).tolist() == [np.inf, np.float32(-LARGEST / 12.92)]
    assert linear_to_srgb(-LARGEST) == -np.inf and np.isfinite(linear_to_srgb(LARGEST))
    assert displayed([LARGEST, -LARGEST], 1e-9).tolist() == [1, 0]


def test_the_curve_of_training_is_a_line_below_its_knee_that_of_srgb_up_to_1_and_a_logarithm_from_there():
    linear = np.array([-0.5, 0, 0.001, 0.003, 0.004, 0.2, 0.9, 1, np.e, 1000])
    below, above = 12.92 * linear[:4], 1 + 1.055 / 2.4 * np.log(linear[7:])
    encoded = linear_to_srgb_log(linear)
    assert encoded == pytest.approx([*below, *(1.055 * linear[4:7] ** (1 / 2.4) - 0.055), *above], rel=1e-12)
    assert srgb_log_to_linear(encoded) == pytest.approx(linear, rel=1e-12)
