"""The tiled float64 twin beside the plain one: a small camera, and what is compared."""

from typing import Any

import numpy as np
from mi_dogsplat import reference
from mi_dogsplat.reference.gradients import render_tiled
from splat_scenes import random_splats, tilted_camera

BACKGROUND = (0.2, -0.3, 0.6)
SMOOTH: dict[str, Any] = {"min_alpha": 0, "min_transmittance": 0}
MODES = [{"antialiased": a, "negative_transmittance": n} for a in (False, True) for n in (True, False)]
SMALL = tilted_camera(20, 18, f=18.0, cx=8.0, cy=9.5)  # four tiles


def adjoint_of(camera) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(camera.height, camera.width, 3))


def at_limits(seed: int, **shares) -> Any:
    """Ten primitives, some of them where a kernel or the projection is held at a limit."""
    splats = random_splats(10, seed=seed, degree=1, **shares)
    splats.logit_opacities[:2] = 8  # saturated
    splats.log_scales[:2] = 1
    splats.means[4, 0] = 9  # seen from the side, where the linearisation is clamped
    splats.log_scales[4] = 1
    return splats


def assert_images_equal(splats, camera, smooth=False, background=BACKGROUND, **choices):
    image, T, _ = reference.render(splats, camera, background, smooth=smooth, **choices)
    ours = render_tiled(splats, camera, background, **choices, **(SMOOTH if smooth else {}))
    np.testing.assert_allclose(ours.image, image, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(ours.T, T, rtol=1e-12, atol=1e-12)
    return ours


def assert_gradients_near(got: dict, expected: dict, rtol=1e-6):
    """The same parameters, and entry by entry, but for the noise of differences: 1e-7 of the largest."""
    assert tuple(got) == tuple(expected)
    for name, values in expected.items():
        atol = 0.1 * rtol * np.abs(values).max(initial=0)
        np.testing.assert_allclose(got[name], values, rtol=rtol, atol=atol, err_msg=name)
