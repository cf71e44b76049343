"""Derivatives as Mitsuba's own suite asks for them (test_ad_integrators.py), in our words.

One latent variable θ moves a model: it is translated, scaled, turned, made more opaque, recoloured, its DoG parts
change. ``render_forward`` must equal central differences of the float64 twin in every pixel, ``render_backward`` their
sum under an adjoint image, for whole images, crop windows and films of several kinds; ``mi.render`` must route both.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.parameters import RAW, RAW_DOG
from splat_scenes import random_splats, rounded, scene_of, square_camera

from benchmarks.numerics.derivative_cases import linear

CAMERA = square_camera(24, 16, f=20.0)
MODEL = rounded(random_splats(15, seed=6, degree=1))
CROP = {"crop_offset_x": 5, "crop_offset_y": 3, "crop_width": 13, "crop_height": 9}
LUMINANCE = np.array([0.212671, 0.715160, 0.072169])


def turning() -> dict[str, np.ndarray]:
    """The tangent of a rotation about a tilted axis through the middle of the model."""
    axis = np.array([0.2, 0.9, 0.4])
    q = MODEL.quats.astype(float)
    vector = 0.5 * (q[:, 3:] * axis + np.cross(axis, q[:, :3]))
    return {"means": np.cross(axis, MODEL.means - MODEL.means.mean(0)),
            "quats": np.concatenate([vector, -0.5 * q[:, :3] @ axis[:, None]], 1)}


def constant(name: str, value: Any) -> dict[str, np.ndarray]:
    return {name: np.broadcast_to(value, getattr(MODEL, name).shape)}


MOTIONS: dict[str, dict[str, np.ndarray]] = {  # derivative of the parameters by θ
    "translated": constant("means", [1, 0.5, -0.3]),
    "scaled": {"means": MODEL.means - MODEL.means.mean(0), **constant("log_scales", 1)},
    "turned": turning(),
    "more opaque": constant("logit_opacities", 1),
    "recoloured": constant("sh_coeffs", [0.6, -0.4, 0.2]),
    "less of the negative part": {**constant("dog_logit_opacities", -1), **constant("dog_log_scales", [1, -0.5, 0.2])},
}
MOTIONS["all at once"] = {name: np.sum([0.7 * motion[name] for motion in MOTIONS.values() if name in motion], axis=0)
                          for name in RAW + RAW_DOG}


def expected(splats: Any = MODEL) -> np.ndarray:
    return linear(reference.render(splats, CAMERA)[0])


FILMS: dict[str, tuple[dict, dict, Callable[[Any], np.ndarray]]] = {  # film, integrator, its float64 twin
    "rgb": ({}, {}, expected),
    "crop window": (CROP, {}, lambda s: expected(s)[3:12, 5:18]),
    "rgba": ({"pixel_format": "rgba"}, {},
             lambda s: np.dstack([expected(s), 1 - reference.render(s, CAMERA)[1]])),
    "luminance": ({"pixel_format": "luminance"}, {}, lambda s: (expected(s) @ LUMINANCE)[..., None]),
    "blended values": ({}, {"srgb_primitives": False}, lambda s: reference.render(s, CAMERA)[0]),
    "antialiased": ({}, {"antialiased": True}, lambda s: linear(reference.render(s, CAMERA, antialiased=True)[0])),
    "alpha as an AOV": ({}, {"aovs": "alpha"},
                        lambda s: np.dstack([expected(s), 1 - reference.render(s, CAMERA)[1]])),
}
CASES = [(motion, "rgb") for motion in MOTIONS] + [("all at once", film) for film in FILMS if film != "rgb"]


def at(theta: float, motion: str) -> Any:
    raw = {name: getattr(MODEL, name).astype(float) + theta * MOTIONS[motion].get(name, 0) for name in RAW + RAW_DOG}
    return SimpleNamespace(**raw, dog_index=MODEL.dog_index)


def moving(motion: str, film: str) -> tuple[Any, Any, Any]:
    """(scene, its parameters, θ = 0 that they depend on)."""
    of_film, of_integrator, _ = FILMS[film]
    scene: Any = scene_of(MODEL, CAMERA, film=of_film, **of_integrator)
    params: Any = mi.traverse(scene)
    theta: Any = mi.Float(0)
    dr.enable_grad(theta)
    for name, tangent in MOTIONS[motion].items():
        start: Any = mi.TensorXf(getattr(MODEL, name))
        params[f"splats.{name}"] = start + mi.TensorXf(np.ascontiguousarray(tangent, np.float32)) * theta
    params.update()
    return scene, params, theta


def differences(motion: str, film: str) -> np.ndarray:
    """d image / dθ; the step is so small that no pixel crosses a cutoff."""
    twin, eps = FILMS[film][2], 1e-7
    return (twin(at(eps, motion)) - twin(at(-eps, motion))) / (2 * eps)


def assert_derivative(got: np.ndarray, wanted: np.ndarray):
    assert got.shape == wanted.shape and np.abs(wanted).max() > 0.05
    assert np.abs(got - wanted).max() < 1e-3 * np.abs(wanted).max()


@pytest.mark.parametrize("motion, film", CASES)
def test_forward_mode_is_the_difference_quotient_in_every_pixel(motion, film):
    wanted = differences(motion, film)
    scene, _, theta = moving(motion, film)
    dr.forward(theta, dr.ADFlag.ClearEdges)
    assert_derivative(scene.integrator().render_forward(scene, params=theta).numpy(), wanted)

    scene, params, theta = moving(motion, film)
    image = mi.render(scene, params)
    np.testing.assert_allclose(image.numpy(), FILMS[film][2](MODEL), atol=2e-4)
    dr.forward(theta)
    assert_derivative(dr.grad(image).numpy(), wanted)


@pytest.mark.parametrize("motion, film", CASES)
def test_reverse_mode_is_the_difference_quotient_under_an_adjoint_image(motion, film):
    wanted = differences(motion, film)
    adjoint = np.random.default_rng(2).normal(size=wanted.shape).astype(np.float32)
    tolerance = 1e-3 * np.abs(adjoint * wanted).sum()
    assert tolerance > 1e-3

    scene, _, theta = moving(motion, film)
    scene.integrator().render_backward(scene, params=theta, grad_in=mi.TensorXf(adjoint))
    assert abs(float(dr.grad(theta)[0]) - np.sum(adjoint * wanted)) < tolerance

    scene, params, theta = moving(motion, film)
    dr.backward(dr.sum(mi.render(scene, params) * mi.TensorXf(adjoint), axis=None))
    assert abs(float(dr.grad(theta)[0]) - np.sum(adjoint * wanted)) < tolerance


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    return mi.render(scene_of(MODEL, CAMERA)).numpy()


# Gradients through mi.render

def test_nothing_is_differentiated_where_gradients_are_suspended(image):
    scene: Any = scene_of(MODEL, CAMERA)
    params: Any = mi.traverse(scene)
    dr.enable_grad(params["splats.means"])
    params.update()
    with dr.suspend_grad():
        suspended = mi.render(scene, params)
    assert not dr.grad_enabled(suspended)
    np.testing.assert_array_equal(suspended.numpy(), image)
    assert not dr.grad_enabled(scene.integrator().render(scene))  # only mi.render attaches
    assert dr.grad_enabled(mi.render(scene, params))


def test_gradients_reach_what_params_holds_and_its_parents_but_nothing_without_params():
    """The latter is so with every integrator of Mitsuba, ``prb`` for one."""
    scene: Any = scene_of(MODEL, CAMERA)
    params: Any = mi.traverse(scene)
    shift = mi.Float(0)
    dr.enable_grad(shift)
    log_scales: Any = mi.TensorXf(MODEL.log_scales)
    params["splats.log_scales"] = log_scales + shift
    params.update()
    with pytest.raises(RuntimeError, match="does not depend on the input"):
        dr.backward(dr.mean(mi.render(scene), axis=None))
    dr.backward(dr.mean(mi.render(scene, params), axis=None))
    raw = {name: getattr(MODEL, name).astype(float) for name in RAW + RAW_DOG}
    sides = [SimpleNamespace(**{**raw, "log_scales": raw["log_scales"] + eps}, dog_index=MODEL.dog_index)
             for eps in (1e-7, -1e-7)]  # so small that no pixel crosses a cutoff
    means = [expected(splats=side).mean() for side in sides]
    np.testing.assert_allclose(dr.grad(shift).numpy(), (means[0] - means[1]) / 2e-7, rtol=1e-3)


@pytest.mark.parametrize("integrator", ["dogsplat", "dogpath"])
def test_one_forward_pass_reaches_every_render_of_a_parameter(integrator):
    def tangents(seeds: tuple[Any, ...]) -> list[np.ndarray]:
        scene: Any = scene_of(MODEL, CAMERA, type=integrator)
        params: Any = mi.traverse(scene)
        theta: Any = mi.Float(0)
        dr.enable_grad(theta)
        params["splats.means"] = mi.TensorXf(MODEL.means) + theta
        params.update()
        images = [mi.render(scene, params, spp=2, seed=seed) for seed in seeds]
        dr.forward(theta)
        return [np.array(dr.grad(each)) for each in images]

    alone = [tangents((seed,))[0] for seed in (1, 2)]
    assert np.abs(alone[0] - alone[1]).max() > 1e-3
    np.testing.assert_allclose(tangents((1, 2)), alone, rtol=1e-5, atol=1e-6)


def test_a_forward_pass_that_does_not_reach_the_image_leaves_a_tangent_of_zero():
    ball = {"type": "sphere", "center": [0, 0, 99], "id": "ball"}
    scene: Any = scene_of(MODEL, CAMERA, extra={"ball": ball}, surfaces={"type": "path"})
    params: Any = mi.traverse(scene)
    key = next(name for name in params.keys() if "reflectance" in name)
    theta: Any = mi.Float(0)
    dr.enable_grad(theta)
    params[key] = params[key] + theta
    params.update()
    image = mi.render(scene, params)  # which takes surfaces as constant
    dr.forward(theta)
    assert not np.array(dr.grad(image)).any()


def test_gradients_add_up_over_renders_until_they_are_cleared():
    scene: Any = scene_of(MODEL, CAMERA)
    params: Any = mi.traverse(scene)
    dr.enable_grad(params["splats.sh_coeffs"])
    params.update()
    gradients = []
    for _ in range(2):
        dr.backward(dr.mean(mi.render(scene, params), axis=None))
        gradients.append(dr.grad(params["splats.sh_coeffs"]).numpy().copy())
    assert gradients[0].any()
    np.testing.assert_allclose(gradients[1], 2 * gradients[0], rtol=1e-5, atol=1e-9)
    dr.clear_grad(params["splats.sh_coeffs"])
    assert not dr.grad(params["splats.sh_coeffs"]).numpy().any()


@pytest.mark.parametrize("optimizer", [lambda: mi.ad.Adam(lr=0.02), lambda: mi.ad.SGD(lr=20.0, momentum=0.5)],
                         ids=["Adam", "SGD"])
def test_the_optimizers_of_mitsuba_take_steps_through_a_loss(optimizer, image):
    scene: Any = scene_of(MODEL, CAMERA)
    params: Any = mi.traverse(scene)
    params.keep(r"splats\.sh_coeffs")
    steps: Any = optimizer()
    steps["splats.sh_coeffs"] = mi.TensorXf(MODEL.sh_coeffs + np.float32(0.3))
    params.update(steps)
    target, losses = mi.TensorXf(image), []
    for step in range(8):
        loss = dr.mean(dr.square(mi.render(scene, params, seed=mi.UInt32(step)) - target), axis=None)
        dr.backward(loss)
        steps.step()
        params.update(steps)
        losses.append(float(loss.numpy().ravel()[0]))
    assert losses[-1] < 0.6 * losses[0], losses
