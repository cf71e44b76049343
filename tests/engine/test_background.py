"""Emitters behind the splats: what Mitsuba's own path tracer sees of them, and its derivatives."""

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference, to_dog
from mi_dogsplat.engine.arrays import array_types
from mi_dogsplat.plugin import transfer
from mi_dogsplat.plugin.transfer import linear_to_srgb, srgb_to_linear
from mi_dogsplat.scene.splats import Splats
from splat_scenes import random_splats, rounded, scene_of, sensor_dict, square_camera

MODEL = rounded(random_splats(40, seed=1))
CAMERA = square_camera()
SUN = 5000.0


def to_linear(v):
    return np.where(v <= 0.04045, v / 12.92, (np.maximum(v, 0.04045) + 0.055) ** 2.4 / 1.055**2.4)


def to_srgb(v):
    return np.where(v <= 0.0031308, v * 12.92, 1.055 * np.maximum(v, 0.0031308) ** (1 / 2.4) - 0.055)


def envmap(axis=(2 / 3, 1 / 3, 2 / 3), angle=60.0) -> dict[str, Any]:
    """Without symmetry, each channel its own, and with a sun, which wide sensors see."""
    y, x = np.mgrid[0:32, 0:64]
    image = np.stack([1 + np.sin(x / 10), 1 + np.cos(y / 8), x / 64 + y / 32], -1).astype(np.float32)
    image[3:5, 20:22] = SUN
    return {"type": "envmap", "bitmap": mi.Bitmap(image), "to_world": mi.ScalarTransform4f().rotate(axis, angle)}


def constant(*rgb: float) -> dict[str, Any]:
    return {"type": "constant", "radiance": {"type": "rgb", "value": list(rgb)}}


def path_traced(sensor: dict[str, Any], sky: dict[str, Any]) -> np.ndarray:
    """One sample at each pixel centre, by the path tracer; nothing is random in it, as it meets no surface."""
    scene: Any = mi.load_dict({"type": "scene", "sensor": sensor, "sky": sky})
    film = scene.sensors()[0].film()
    width, height = film.crop_size()
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    position = mi.Point2f(((x + 0.5) / width).ravel(), ((y + 0.5) / height).ravel())
    ray, _ = scene.sensors()[0].sample_ray_differential(0, 0, position, mi.Point2f(0.5))
    integrator: Any = mi.load_dict({"type": "path"})
    sampler: Any = mi.load_dict({"type": "independent"})
    sampler.seed(0, width * height)
    return np.stack([np.array(c) for c in integrator.sample(scene, sampler, ray)[0]], -1).reshape(height, width, 3)


SENSORS = {
    "centred": sensor_dict(CAMERA),
    "off-centre": sensor_dict(square_camera(cx=10, cy=22)),
    "crop": sensor_dict(CAMERA, crop_offset_x=7, crop_offset_y=5, crop_width=20, crop_height=11),
    "wide": {**sensor_dict(square_camera(f=8.0)), "near_clip": 3.0},
    "orthographic": {**sensor_dict(CAMERA), "type": "orthographic"},
}
for dropped in ("fov", "fov_axis", "principal_point_offset_x", "principal_point_offset_y"):
    del SENSORS["orthographic"][dropped]


@pytest.mark.parametrize("srgb_primitives", [True, False])
@pytest.mark.parametrize("sky", [envmap(), envmap((0, 1, 0), -130.0), constant(0.2, 0.5, 150.0)], ids="ABC")
@pytest.mark.parametrize("sensor", SENSORS)
def test_an_emitter_is_seen_as_the_path_tracer_sees_it(sensor, sky, srgb_primitives):
    """However bright: the curve to display values and back loses nothing."""
    scene: Any = mi.load_dict({"type": "scene", "sensor": SENSORS[sensor], "sky": sky,
                               "integrator": {"type": "dogsplat", "srgb_primitives": srgb_primitives},
                               "nothing": to_dog(Splats.empty(0))})
    got, expected = np.array(mi.render(scene)), path_traced(SENSORS[sensor], sky)
    assert expected.std() > 0.1
    np.testing.assert_allclose(got, expected, rtol=2e-4, atol=1e-5)


@pytest.mark.parametrize("srgb_primitives", [True, False])
def test_splats_are_blended_over_it_in_their_own_colour_space(srgb_primitives):
    camera, sky = square_camera(f=12.0), envmap()
    behind = path_traced(sensor_dict(camera), sky)
    image, T, _ = reference.render(MODEL, camera)
    T = T[..., None]
    expected = to_linear(image + T * to_srgb(behind)) if srgb_primitives else image + T * behind
    got = np.array(mi.render(scene_of(MODEL, camera, extra={"sky": sky}, srgb_primitives=srgb_primitives)))
    assert np.median(np.abs(got - expected) / (0.05 + expected)) < 1e-5
    assert np.abs(got - expected).mean() < 1e-4 * expected.mean()


@pytest.mark.parametrize("branches", [True, False], ids=["as on the CPU", "as on CUDA"])
def test_the_curve_on_the_device_is_that_of_the_standard_and_its_inverse(branches, monkeypatch):
    monkeypatch.setattr(transfer, "array_types", lambda: replace(array_types(), is_llvm=branches))
    values = np.concatenate([np.linspace(-2, 2, 4001), np.geomspace(1, 1e5, 100)]).astype(np.float32)
    linear, display = (f([mi.Float(values)])[0].numpy() for f in (srgb_to_linear, linear_to_srgb))
    np.testing.assert_allclose(linear, to_linear(values.astype(float)), rtol=1e-5)
    np.testing.assert_allclose(display, to_srgb(values.astype(float)), rtol=1e-5)
    np.testing.assert_allclose(srgb_to_linear([mi.Float(display)])[0].numpy(), values, rtol=1e-5)
    x = mi.Float(values)
    dr.enable_grad(x)
    dr.backward(srgb_to_linear([x])[0] + linear_to_srgb([x])[0])
    slope = (np.diff(linear) + np.diff(display)) / np.diff(values)
    usual = (np.diff(values) > 5e-4) & (np.abs(values[1:]) > 0.1) & (np.abs(values[1:] - 1) > 0.01) & (values[1:] < 100)
    middle = 0.5 * (dr.grad(x).numpy()[1:] + dr.grad(x).numpy()[:-1])
    assert np.isfinite(dr.grad(x).numpy()).all() and np.abs(middle / slope - 1)[usual].max() < 0.02


def test_hidden_emitters_do_not_show():
    scene = scene_of(MODEL, CAMERA, extra={"sky": envmap()}, hide_emitters=True)
    np.testing.assert_array_equal(np.array(mi.render(scene)), np.array(mi.render(scene_of(MODEL, CAMERA))))


# Derivatives

SMALL_CAMERA = square_camera(16, 12, f=6.0)
SMALL = rounded(random_splats(10, seed=4, degree=0))


# Mitsuba's envmap has a column more than its picture; as loaded (3.9) it has two, and its data have no derivative
TEXELS: Any = mi.TensorXf(np.random.default_rng(2).uniform(0.2, 1, (8, 17, 3)).astype(np.float32))


def gradients(sky: dict[str, Any], name: str, adjoint: np.ndarray, spp: int) -> np.ndarray:
    scene = scene_of(SMALL, SMALL_CAMERA, extra={"sky": sky})
    params: Any = mi.traverse(scene)
    leaf = TEXELS * 1 if name == "sky.data" else params[name]
    dr.enable_grad(leaf)
    params[name] = leaf
    params.update()
    integrator: Any = scene.integrator()
    integrator.render_backward(scene, params, mi.TensorXf(adjoint), spp=spp)
    return np.array(dr.grad(leaf))


def loss(sky: dict[str, Any], name: str, change: Any, adjoint: np.ndarray, spp: int) -> float:
    scene = scene_of(SMALL, SMALL_CAMERA, extra={"sky": sky})
    params: Any = mi.traverse(scene)
    value = TEXELS if name == "sky.data" else params[name]
    params[name] = type(params[name])(value + change)
    params.update()
    return float(np.sum(adjoint.astype(float) * np.array(mi.render(scene, spp=spp))))


@pytest.mark.parametrize("spp", [1, 4])
@pytest.mark.parametrize("name", ["sky.radiance.value", "sky.data", "sky.scale"])
def test_derivatives_of_emitters_equal_differences(name, spp):
    rng = np.random.default_rng(0)
    adjoint = rng.normal(size=(12, 16, 3)).astype(np.float32)
    sky = constant(0.3, 0.5, 0.9) if "radiance" in name else envmap()
    got = gradients(sky, name, adjoint, spp)
    if name == "sky.data":
        direction = rng.normal(size=got.shape).astype(np.float32)
        change = mi.TensorXf(direction)
        eps, expected_of = 1e-2, float(np.sum(got * direction))
        sides = [loss(sky, name, change * side, adjoint, spp) for side in (eps, -eps)]
        assert abs(got).max() > 0.1
        np.testing.assert_allclose(expected_of, (sides[0] - sides[1]) / (2 * eps), rtol=1e-2)
        return
    entries = range(3) if "radiance" in name else range(1)
    for k in entries:
        change = mi.Color3f(*(float(k == c) for c in range(3))) if "radiance" in name else 1.0
        sides = [loss(sky, name, change * side, adjoint, spp) for side in (1e-2, -1e-2)]
        np.testing.assert_allclose(got.ravel()[k], (sides[0] - sides[1]) / 2e-2, rtol=1e-2, err_msg=str(k))
