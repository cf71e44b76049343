"""Derivatives of ``mi.render`` through the film, in both modes, against differences of the float64 twin."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.reference.forward import RAW_PARAMETERS
from mi_dogsplat.scene.splats import Splats
from read_together import read_gradients
from splat_scenes import (
    assert_gradients_equal,
    differences,
    dog_dict,
    random_splats,
    rounded,
    scene_of,
    sensor_dict,
    square_camera,
    to_linear,
    to_srgb,
)

SMALL_CAMERA = square_camera(16, 12, f=14.0)
SMALL = rounded(random_splats(10, seed=4, degree=1))
ADJOINT = np.random.default_rng(0).normal(size=(12, 16, 4)).astype(np.float32)
SKY = {"type": "constant", "radiance": {"type": "rgb", "value": [0.3, 0.5, 0.9]}}


def small_scene(**choices) -> tuple[mi.Scene, Any]:
    scene = scene_of(SMALL, SMALL_CAMERA, film={"pixel_format": "rgba"}, extra={"sky": SKY}, **choices)
    return scene, mi.traverse(scene)


def enable(params: Any) -> dict[str, Any]:
    tensors = {name: params[f"splats.{name}"] for name in RAW_PARAMETERS}
    for name, tensor in tensors.items():
        dr.enable_grad(tensor)
        params[f"splats.{name}"] = tensor
    params.update()
    return tensors


def film_of(splats: Splats) -> np.ndarray:
    """What ``small_scene`` shows, by the twin."""
    image, T, _ = reference.render(splats, SMALL_CAMERA, to_srgb(np.array([0.3, 0.5, 0.9])))
    return np.dstack([to_linear(image), 1 - T])


@pytest.fixture(scope="module")
def film_gradients() -> dict[str, np.ndarray]:
    # Steps so small that no pixel of this scene crosses a cutoff.
    return differences(SMALL, lambda splats: float(np.sum(ADJOINT * film_of(splats))), eps=1e-7)


def test_the_small_scene_renders_as_its_twin():
    scene, _ = small_scene()
    assert np.abs(np.array(mi.render(scene)) - film_of(SMALL)).mean() < 2e-5


def test_backward_mode_through_the_film_equals_differences(film_gradients):
    scene, params = small_scene()
    tensors = enable(params)
    image = mi.render(scene, params)
    dr.backward(dr.sum(image * mi.TensorXf(ADJOINT)))
    got = read_gradients(params, tensors, "splats.")
    assert_gradients_equal(got, film_gradients)


@pytest.mark.parametrize("seed", [0, 1])
def test_forward_mode_through_the_film_is_adjoint_to_the_differences(film_gradients, seed):
    rng = np.random.default_rng(seed)
    for name in RAW_PARAMETERS:
        scene, params = small_scene()
        tensors = enable(params)
        direction = rng.normal(size=getattr(SMALL, name).shape).astype(np.float32)
        dr.set_grad(params[f"splats.{name}"], mi.TensorXf(direction))
        image = mi.render(scene, params)
        dr.forward_to(image)
        got = float(np.sum(ADJOINT * dr.grad(image).numpy()))
        terms = film_gradients[name] * direction
        assert abs(got - terms.sum()) < 1e-2 * np.abs(terms).sum(), name
        assert tensors


def test_derivatives_belong_to_the_image_they_are_asked_for():
    """Two scenes and changed parameters between the primal and the derivative pass: no stage is taken for another's."""
    (scene_a, params_a), (scene_b, params_b) = small_scene(), small_scene(antialiased=True)
    enable(params_a)
    enable(params_b)
    adjoint = mi.TensorXf(ADJOINT)

    def gradient(params) -> np.ndarray:
        return dr.grad(params["splats.log_scales"]).numpy()

    dr.backward(dr.sum(mi.render(scene_a, params_a) * adjoint))
    dr.backward(dr.sum(mi.render(scene_b, params_b) * adjoint))
    alone_a, alone_b = gradient(params_a).copy(), gradient(params_b).copy()
    assert np.abs(alone_a - alone_b).max() > 1e-2
    for params in (params_a, params_b):
        dr.clear_grad(params["splats.log_scales"])
    image_a, image_b = mi.render(scene_a, params_a), mi.render(scene_b, params_b)
    dr.eval(mi.render(scene_a, sensor=0))
    dr.backward(dr.sum(image_a * adjoint))
    dr.backward(dr.sum(image_b * adjoint))
    scale = np.abs(alone_a).max()
    np.testing.assert_allclose(gradient(params_a), alone_a, rtol=1e-3, atol=1e-4 * scale)
    np.testing.assert_allclose(gradient(params_b), alone_b, rtol=1e-3, atol=1e-4 * scale)


def test_gradients_of_several_renders_add_up():
    def gradients(*focal_lengths: float) -> dict[str, np.ndarray]:
        scene, params = small_scene()
        tensors = enable(params)
        for f in focal_lengths:
            sensor: Any = mi.load_dict(sensor_dict(square_camera(16, 12, f=f), pixel_format="rgba"))
            dr.backward(dr.sum(mi.render(scene, params, sensor=sensor) * mi.TensorXf(ADJOINT)))
        return read_gradients(params, tensors, "splats.")

    first, second, both = gradients(14.0), gradients(20.0), gradients(14.0, 20.0)
    for name, total in both.items():
        np.testing.assert_allclose(total, first[name] + second[name], atol=1e-5 * np.abs(total).max(), err_msg=name)


def test_a_parameter_that_no_gradient_is_asked_for_gets_none():
    scene, params = small_scene()
    dr.enable_grad(params["splats.means"])
    params.update()
    dr.backward(dr.sum(mi.render(scene, params)))
    assert dr.grad(params["splats.means"]).numpy().any()
    assert not dr.grad_enabled(params["splats.quats"])


def test_several_shapes_receive_their_own_gradients(film_gradients):
    index = SMALL.dog_index
    first, second = SMALL.select(np.arange(6)), SMALL.select(np.arange(6, 10))
    assert 0 < first.n_dog < len(index)
    scene = scene_of(first, SMALL_CAMERA, film={"pixel_format": "rgba"},
                     extra={"sky": SKY, "rest": dog_dict(second)})
    params: Any = mi.traverse(scene)
    names = [f"{shape}.{name}" for shape in ("splats", "rest") for name in RAW_PARAMETERS]
    for name in names:
        dr.enable_grad(params[name])
    params.update()
    dr.backward(dr.sum(mi.render(scene, params) * mi.TensorXf(ADJOINT)))
    found = read_gradients(params, names)
    got = {name: np.concatenate([found[f"{shape}.{name}"] for shape in ("splats", "rest")]) for name in RAW_PARAMETERS}
    assert_gradients_equal(got, film_gradients)


def test_mitsubas_adam_on_all_parameters_reduces_a_loss():
    target = mi.TensorXf(film_of(SMALL).astype(np.float32))
    start = Splats(**{name: getattr(SMALL, name) + np.float32(0.15) * np.random.default_rng(1).normal(
        size=getattr(SMALL, name).shape).astype(np.float32) for name in RAW_PARAMETERS}, dog_index=SMALL.dog_index)
    scene = scene_of(start, SMALL_CAMERA, film={"pixel_format": "rgba"}, extra={"sky": SKY})
    params: Any = mi.traverse(scene)
    optimizer: Any = mi.ad.Adam(lr=0.02)
    for name in RAW_PARAMETERS:
        optimizer[f"splats.{name}"] = params[f"splats.{name}"]
    params.update(optimizer)
    losses = []
    for _ in range(10):
        loss = dr.mean(dr.square(mi.render(scene, params) - target), axis=None)
        dr.backward(loss)
        optimizer.step()
        params.update(optimizer)
        losses.append(float(np.array(loss).ravel()[0]))
    assert losses[-1] < 0.6 * losses[0], losses


def test_gradients_of_several_passes_are_the_same_in_a_variant_with_one_channel():
    """There the three channels of a sample are one variable."""
    if "llvm_ad_mono" not in mi.variants():
        pytest.skip("llvm_ad_mono is not built into this Mitsuba")

    def gradient() -> np.ndarray:
        scene = scene_of(SMALL, SMALL_CAMERA, film={"pixel_format": "luminance"}, extra={"sky": {"type": "constant"}})
        params: Any = mi.traverse(scene)
        dr.enable_grad(params["splats.logit_opacities"])
        params.update()
        dr.backward(dr.sum(mi.render(scene, params, spp=2), axis=None))
        return dr.grad(params["splats.logit_opacities"]).numpy()

    expected = gradient()
    mi.set_variant("llvm_ad_mono")
    np.testing.assert_allclose(gradient(), expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())
