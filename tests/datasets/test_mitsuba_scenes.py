"""The regression scenes of Mitsuba's ``volprim_rf_basic`` (test_volprim_rf_basic.py) with our shape.

A ring of ellipsoids side by side and a fan of needles on top of each other. Mitsuba compares its renders with pictures
that it ships; ours are compared with the float64 twin, and with ``volprim_rf_basic`` on the same ellipsoids.
"""

from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.measure.metrics import psnr
from mi_dogsplat.scene.mitsuba_cameras import camera_from_mitsuba
from mi_dogsplat.scene.splats import Splats
from splat_scenes import dog_dict, logit

from benchmarks.renderers.ellipsoids import at_centres, scenes
from benchmarks.renderers.ray_model import VOLPRIM, render_points

SENSOR = {
    "type": "perspective", "fov": 61.9275,
    "to_world": mi.ScalarTransform4f().look_at([0, 0, -5], [0, 0, 0], [0, 1, 0]),
    "film": {"type": "hdrfilm", "rfilter": {"type": "tent"}, "width": 128, "height": 128, "pixel_format": "rgb"},
}


def ring(radius: float, thickness: np.ndarray, length: float, rise: float, opacity: float, turn: float) -> Splats:
    """Twelve ellipsoids on a circle, each turned with it; green and blue fade into each other, red swells and ebbs."""
    t = np.arange(12) / 12
    half = np.radians(-360 * t + turn) / 2
    zero = 0 * t
    colors = np.stack([np.abs(np.sin(np.pi * t)), 1 - t, t], 1)  # degree 0 of the SH, as Mitsuba's scenes have it
    return Splats(
        means=np.stack([radius * np.sin(2 * np.pi * t), radius * np.cos(2 * np.pi * t), rise * t], 1),
        log_scales=np.log(np.stack([thickness, length * thickness, thickness], 1)),
        quats=np.stack([zero, zero, np.sin(half), np.cos(half)], 1),
        logit_opacities=np.full(12, logit(opacity)),
        sh_coeffs=colors[:, None],
    )


T = np.arange(12) / 12
SPAN = ring(2.5, 0.05 + 0.2 * T, 3, 0.01, 1 - 1e-6, 0)
STACK = ring(1.0, 0.15 + 0.15 * T, 8, 0.2, 0.5, 45)
CASES = pytest.mark.parametrize("splats", [SPAN, STACK], ids=["span", "stack"])


def render(splats: Splats, **integrator) -> tuple[np.ndarray, Any]:
    """(the image, the camera)."""
    scene: Any = mi.load_dict({"type": "scene", "sensor": SENSOR, "shape": dog_dict(splats),
                               "integrator": {"type": "dogsplat", **integrator}})
    return mi.render(scene).numpy(), camera_from_mitsuba(scene.sensors()[0])


@CASES
@pytest.mark.parametrize("srgb_primitives", [True, False])
def test_the_scene_is_that_of_the_twin_in_either_colour_space(splats, srgb_primitives):
    image, camera = render(splats, srgb_primitives=srgb_primitives)
    expected = reference.render(splats, camera)[0]
    if srgb_primitives:
        expected = mi.math.srgb_to_linear(mi.Float(expected.ravel().astype(np.float32))).numpy().reshape(image.shape)
    assert np.abs(image - expected).mean() < 1e-5 and expected.max() > 0.4


@CASES
def test_the_depth_is_that_of_the_twin(splats):
    image, camera = render(splats, aovs="depth")
    _, transmittance, depth = reference.render(splats, camera)
    solid = transmittance < 0.9
    expected = depth[solid] / (1 - transmittance[solid])
    assert solid.mean() > 0.05
    np.testing.assert_allclose(image[..., 3][solid], expected, rtol=1e-3)
    nearest, farthest = splats.means[:, 2].min() + 5, splats.means[:, 2].max() + 5
    assert nearest - 1e-3 <= expected.min() and expected.max() <= farthest + 1e-3


@pytest.mark.parametrize("splats, least", [(SPAN, 35), (STACK, 25)], ids=["span", "stack"])
def test_volprim_renders_the_same_scene_within_the_differences_that_are_known(splats, least):
    """The low-pass filter where primitives are side by side; where they overlap, the order as well."""
    image, camera = render(splats, srgb_primitives=False)
    scene = scenes(splats, camera)[1]
    traced = at_centres(scene.integrator(), scene, camera)
    assert psnr(image, traced) > least
    points = np.stack(reference.pixel_centres(0, 0, 128, 128), 1)
    model = render_points(splats, camera, points, VOLPRIM).reshape(traced.shape)
    assert psnr(model, traced) > 45
