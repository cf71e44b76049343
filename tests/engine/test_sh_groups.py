"""Models whose primitives have SH degrees of their own: pictures, derivatives, and models put together or moved."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.motion import moved
from mi_dogsplat.engine.parameters import concatenate, upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.rasterize import Frame, rasterize
from mi_dogsplat.engine.sh_groups import padded_rows
from mi_dogsplat.scene.cameras import affine
from mi_dogsplat.scene.row_groups import SH
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.transform import transformed
from read_together import read, read_gradients
from splat_scenes import (
    SMOOTH_OPTIONS,
    assert_gradients_equal,
    axis_rotation,
    image_of,
    options,
    random_splats,
    rasterized,
    rounded,
    tilted_camera,
)

CAMERA = tilted_camera(16, 12, f=14.0, cx=7.0, cy=6.5)
ADJOINT = np.random.default_rng(0).normal(size=(12, 16, 3))
GROUPS = tuple(name for group in SH.values() for name in group.names)


def mixed(n=60, degrees=None, seed=3, **settings) -> Splats:
    chosen = np.arange(n) % 4 if degrees is None else degrees
    return rounded(random_splats(n, seed=seed, **settings)).with_sh_degrees(chosen)


def colors(splats: Splats, camera: Any, degree: int, **choices) -> tuple[np.ndarray, np.ndarray]:
    """(colours [N, 3], visible [N])"""
    p = project(upload(splats), camera, sh_degree=degree, **choices)
    *planes, visible = read([*p.colors, p.visible])
    return np.stack(planes, 1), visible


# --- pictures ---


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("dog_share", [0, 0.5])
def test_colours_are_those_of_the_twin_up_to_the_degree_asked_for(degree, dog_share):
    splats, camera = mixed(dog_share=dog_share), tilted_camera()
    got, visible = colors(splats, DeviceCamera.upload(camera), degree)
    twin = reference.project(splats, camera, sh_degree=degree)
    assert np.array_equal(visible, twin.visible) and 10 < visible.sum()
    np.testing.assert_allclose(got[visible], twin.colors[visible], atol=2e-6)


@pytest.mark.parametrize("degrees", [[0, 3] * 30, [1] + [0] * 59, [3] * 59 + [2]], ids=["0 and 3", "one", "but one"])
def test_a_model_need_not_have_all_degrees(degrees):
    splats = mixed(degrees=degrees)
    ours, padded = (image_of(rasterized(s, tilted_camera()), tilted_camera()) for s in (splats, splats.uniform_sh()))
    np.testing.assert_allclose(ours, padded, atol=2e-6)


def test_parallel_rays_all_have_one_direction():
    camera = DeviceCamera.upload(tilted_camera(f=20.0), perspective=False)
    (ours, visible), (padded, _) = (colors(s, camera, 3) for s in (mixed(), mixed().uniform_sh()))
    assert visible.any()
    np.testing.assert_allclose(ours[visible], padded[visible], atol=2e-6)


def test_a_degree_that_no_group_has_is_an_error():
    with pytest.raises(ValueError, match="SH degree 3 needs a group of it, the highest one is of degree 2"):
        colors(mixed(degrees=np.arange(60) % 3), DeviceCamera.upload(CAMERA), 3)


def test_a_primitive_whose_own_coefficients_are_not_finite_is_not_visible():
    splats = mixed()
    _, before = colors(splats, DeviceCamera.upload(CAMERA), 3)
    row = int(np.flatnonzero(before[splats.sh2_index])[0])
    splats.sh2_coeffs[row, 7, 2] = np.inf
    _, visible = colors(splats, DeviceCamera.upload(CAMERA), 3)
    assert np.flatnonzero(visible != before).tolist() == [splats.sh2_index[row]]
    assert np.array_equal(colors(splats, DeviceCamera.upload(CAMERA), 1)[1], before)


def test_primitives_on_the_camera_centre_have_finite_colours_and_derivatives():
    splats = mixed(4)
    splats.means[:] = 0
    params = upload(splats)
    dr.enable_grad(params["means"])
    p = project(params, DeviceCamera.upload(tilted_camera(), 0.0), sh_degree=3)
    dr.backward(dr.sum(p.colors[0] + p.x))
    assert np.isfinite(dr.grad(params["means"]).numpy()).all() and np.isfinite(p.colors[0].numpy()).all()


# --- derivatives ---


def attached(splats: Splats) -> dict:
    params = upload(splats)
    dr.enable_grad([value for value in params.values() if dr.is_diff_v(value) and dr.is_float_v(value)])
    return params


def image_loss(frame: Frame) -> mi.Float:
    loss = mi.Float(0)
    for channel, color in enumerate(frame.colors):
        loss += dr.sum(color * mi.Float(ADJOINT[..., channel].ravel()))
    return loss


def gradients(splats: Splats, **choices) -> dict[str, np.ndarray]:
    params = attached(splats)
    frame = rasterize(params, DeviceCamera.upload(CAMERA), options(splats, **choices))
    dr.backward(image_loss(frame))
    names = [name for name, value in params.items() if dr.grad_enabled(value)]
    read_gradients(params, names)  # together
    return {name: gradient(params, name, splats) for name in names}


def gradient(params: dict, name: str, splats: Splats) -> np.ndarray:
    """In the shape of the parameter, without the padding of rows."""
    shape = getattr(splats, name).shape
    if name not in GROUPS:
        return dr.grad(params[name]).numpy().reshape(shape)
    padded = dr.grad(params[name]).numpy().reshape(shape[0], -1, 3)
    assert padded.shape[1] % 4 == 0 and not padded[:, shape[1] :].any()
    return padded[:, : shape[1]]


@pytest.mark.parametrize("dog_share", [0, 0.5])
def test_gradients_equal_differences_in_float64(dog_share):
    splats = mixed(9, dog_share=dog_share)
    got = gradients(splats, **SMOOTH_OPTIONS)
    assert set(GROUPS) <= set(got)
    assert_gradients_equal(got, reference.loss_gradients(splats, CAMERA, ADJOINT))


def test_a_lower_degree_has_no_gradient_for_the_bands_above():
    splats = mixed(9)
    got = gradients(splats.with_sh_degrees(np.minimum(splats.sh_degrees, 1)), **SMOOTH_OPTIONS)["sh1_coeffs"]
    params = attached(splats)
    frame = rasterize(params, DeviceCamera.upload(CAMERA), options(splats.uniform_sh(1), **SMOOTH_OPTIONS))
    dr.backward(image_loss(frame))
    merged = np.zeros((9, 15, 3))
    for group in SH.values():
        rows = gradient(params, group.names[0], splats)
        merged[getattr(splats, group.index), : rows.shape[1]] = rows
    assert not merged[:, 3:].any()
    np.testing.assert_allclose(merged[splats.sh_degrees > 0, :3], got, rtol=1e-4, atol=1e-6 * np.abs(got).max())


@pytest.mark.parametrize("name", ["means", *GROUPS])
def test_forward_mode_equals_backward_mode(name):
    splats, rng = mixed(9), np.random.default_rng(1)
    params = upload(splats)
    tangent = rng.normal(size=getattr(splats, name).shape).astype(np.float32)
    dr.enable_grad(params[name])
    on_device = padded_rows(tangent) if name in GROUPS else tangent
    dr.set_grad(params[name], mi.Float(on_device.ravel()))
    frame = rasterize(params, DeviceCamera.upload(CAMERA), options(splats, **SMOOTH_OPTIONS))
    dr.enqueue(dr.ADMode.Forward, params[name])
    dr.traverse(dr.ADMode.Forward)
    δ = np.stack([dr.grad(c).numpy() for c in frame.colors], -1).reshape(ADJOINT.shape)
    backward = gradients(splats, **SMOOTH_OPTIONS)[name]
    np.testing.assert_allclose((δ * ADJOINT).sum(), (tangent * backward).sum(), rtol=1e-3)


# --- put together and moved ---


def test_a_uniform_model_beside_a_mixed_one_becomes_a_group_of_its_degree():
    models = [mixed(12), rounded(random_splats(5, degree=2)), rounded(random_splats(3, degree=0)), mixed(9, seed=4)]
    sizes = [(m.sh_degree + 1) ** 2 for m in models]
    joined, size = concatenate([upload(m) for m in models], sizes)
    assert size == 16
    expected = np.concatenate([m.uniform_sh(3).sh_coeffs for m in models])
    degrees = np.concatenate([m.sh_degrees for m in models])
    np.testing.assert_array_equal(joined["sh_coeffs"].numpy().reshape(-1, 3), expected[:, 0])
    for degree, group in SH.items():
        index = joined[group.index].numpy()
        assert np.array_equal(index, np.flatnonzero(degrees == degree))
        rows = joined[group.names[0]].numpy().reshape(len(index), -1, 3)
        np.testing.assert_array_equal(rows[:, : (degree + 1) ** 2 - 1], expected[index, 1 : (degree + 1) ** 2])


def test_joining_passes_gradients_to_every_group():
    parts = [attached(mixed(9)), attached(rounded(random_splats(3, degree=1)))]
    joined, _ = concatenate(parts, [16, 4])
    weights = [mi.Float(np.arange(dr.width(joined[name]), dtype=np.float32)) for name in ("sh1_coeffs", "sh3_coeffs")]
    dr.backward(dr.sum(joined["sh1_coeffs"] * weights[0]) + dr.sum(joined["sh3_coeffs"] * weights[1]))
    first, second = np.split(weights[0].numpy().reshape(-1, 12), [2])
    np.testing.assert_array_equal(dr.grad(parts[0]["sh1_coeffs"]).numpy(), first.ravel())
    np.testing.assert_array_equal(dr.grad(parts[0]["sh3_coeffs"]).numpy(), weights[1].numpy())
    uniform = dr.grad(parts[1]["sh_coeffs"]).numpy().reshape(3, 12)
    np.testing.assert_array_equal(uniform[:, 3:], second[:, :9])
    assert not uniform[:, :3].any()


SIMILARITY = affine(1.7 * axis_rotation([1, -2, 0.7], 2.1)[0], (0.4, -3, 2))


def test_a_moved_model_keeps_its_degrees_and_turns_all_bands():
    splats = mixed(20)
    ours, padded = transformed(splats, SIMILARITY), transformed(splats.uniform_sh(), SIMILARITY)
    assert ours.sh_degrees.tolist() == splats.sh_degrees.tolist()
    np.testing.assert_allclose(ours.uniform_sh().sh_coeffs, padded.sh_coeffs, atol=1e-6)
    np.testing.assert_array_equal(ours.means, padded.means)


def test_a_model_moved_on_the_device_is_that_moved_on_the_host():
    splats = mixed(20)
    expected = upload(transformed(splats, SIMILARITY))
    got = moved(upload(splats), mi.Transform4f(SIMILARITY))
    for name in ("sh_coeffs", *GROUPS):
        np.testing.assert_allclose(got[name].numpy(), expected[name].numpy(), atol=1e-5, err_msg=name)


def test_a_quaternion_of_zero_is_turned_on_the_device_as_on_the_host():
    splats = rounded(random_splats(4, degree=0))
    splats.quats[2] = 0
    got = moved(upload(splats), mi.Transform4f(SIMILARITY))["quats"].numpy().reshape(-1, 4)
    expected = transformed(splats, SIMILARITY).quats
    signs = np.sign((got * expected).sum(axis=1, keepdims=True))
    np.testing.assert_allclose(got * signs, expected, atol=1e-6)


def test_a_model_of_nothing_is_moved_to_nothing():
    nothing = upload(mixed(4).select(np.zeros(4, bool)))
    assert dr.width(moved(nothing, mi.Transform4f(SIMILARITY))["means"]) == 0
