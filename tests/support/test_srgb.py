"""The sRGB curve at the ends of what float32 can say; its values are checked where pictures are."""

import numpy as np
from mi_dogsplat.support.srgb import displayed, linear_to_srgb, srgb_to_linear

LARGEST = float(np.finfo(np.float32).max)


def test_what_float32_cannot_say_is_infinite_without_a_warning():
    assert srgb_to_linear([LARGEST, -LARGEST]).tolist() == [np.inf, np.float32(-LARGEST / 12.92)]
    assert linear_to_srgb(-LARGEST) == -np.inf and np.isfinite(linear_to_srgb(LARGEST))
    assert displayed([LARGEST, -LARGEST], 1e-9).tolist() == [1, 0]
