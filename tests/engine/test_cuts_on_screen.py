"""By how much n.w changes from pixel to pixel, as the engine has it: to float32, and no more than a picture shows."""

import mitsuba as mi
import numpy as np
from mi_dogsplat.engine.cuts import cut_on_screen


def test_no_cut_is_steeper_than_sixteen_per_pixel_in_the_engine():
    """In units of log2; longer ones are shortened in their direction, whatever their length."""
    rng, n = np.random.default_rng(0), 400
    normals = (rng.normal(size=(3, n)) * np.geomspace(1e-3, 1e30, n)).astype(np.float32)
    per_pixel = rng.normal(size=(3, 2, n)).astype(np.float32)
    h = np.einsum("an,acn->cn", normals.astype(np.float64), per_pixel.astype(np.float64))
    length = np.hypot(*h)
    assert ((length > 16) & (length < 24)).any() and (length < 16).any()  # on both sides of what is the steepest
    expected = h * np.minimum(1, 16 / length) / np.log(2)
    on_device = [mi.Float(row) for row in normals]
    got = cut_on_screen(on_device, [(mi.Float(x), mi.Float(y)) for x, y in per_pixel])
    np.testing.assert_allclose([column.numpy() for column in got], expected, rtol=1e-5, atol=2e-5)
