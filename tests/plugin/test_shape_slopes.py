"""The shape and the integrators with primitives whose colour varies over them."""

from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from film_derivatives import errors_of_adam, film_gradients
from mi_dogsplat import Splats, reference, to_ellipsoids, write_ply
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, upload
from mi_dogsplat.engine.project import DeviceCamera
from mi_dogsplat.plugin import splat_integrator
from mi_dogsplat.plugin.camera_masks import SplatMasks
from mi_dogsplat.scene.transform import transformed
from splat_scenes import (
    assert_gradients_equal,
    axis_rotation,
    dog_dict,
    image_of,
    options,
    random_splats,
    rasterized,
    rounded,
    scalar_transform,
    scene_of,
    square_camera,
    to_linear,
)

CAMERA = square_camera(16, 12, f=14.0)
ADJOINT = np.random.default_rng(0).normal(size=(12, 16, 3))


def varying(n=12, seed=1, degree=1) -> Splats:
    return rounded(random_splats(n, seed, degree, slope_share=0.5))


MODEL = varying()


def picture(splats: Splats, **others) -> np.ndarray:
    return mi.render(scene_of(splats, CAMERA, **others)).numpy()


def traversed(splats: Splats = MODEL, **others) -> tuple[Any, Any]:
    scene: Any = scene_of(splats, CAMERA, **others)
    return scene, mi.traverse(scene)


@pytest.mark.parametrize("source", ["tensors", "file"])
def test_slopes_go_in_are_seen_and_come_out(tmp_path, source):
    write_ply(tmp_path / "model.ply", MODEL)
    file = {"type": "dog", "filename": str(tmp_path / "model.ply")}
    shape: Any = mi.load_dict(file if source == "file" else dog_dict(MODEL))
    params: Any = mi.traverse(shape)
    assert set(params.keys()) == {*RAW, *RAW_DOG, "dog_index", "color_slopes", "slope_index", "to_world"}
    assert params["color_slopes"].shape == (MODEL.n_slopes, 3, 3)
    assert params.flags("color_slopes") == mi.ParamFlags.Differentiable
    assert params.flags("slope_index") == mi.ParamFlags.NonDifferentiable
    for name in ("slope_index", "color_slopes"):
        np.testing.assert_array_equal(getattr(shape.to_splats(), name), getattr(MODEL, name))
    assert f"slopes = {MODEL.n_slopes}" in str(shape)
    assert "slopes" not in str(mi.load_dict(dog_dict(MODEL.without_slopes())))
    given = upload(MODEL)
    assert set(shape.parameters) == set(given)
    np.testing.assert_array_equal(shape.parameters["slope_row"].numpy(), given["slope_row"].numpy())


def test_pictures_are_those_of_the_engine():
    assert np.isin(MODEL.dog_index, MODEL.slope_index).any()
    ours = picture(MODEL, srgb_primitives=False)
    np.testing.assert_allclose(ours, image_of(rasterized(MODEL, CAMERA), CAMERA), atol=1e-5)
    assert np.abs(ours - picture(MODEL.without_slopes(), srgb_primitives=False)).max() > 0.05


def test_dogpath_shows_them_to_the_camera_as_dogsplat_does():
    np.testing.assert_array_equal(picture(MODEL, type="dogpath"), picture(MODEL))


def test_gradients_through_the_film_equal_differences(monkeypatch):
    """Without cutoffs: no alpha appears at once where a parameter moves."""
    monkeypatch.setattr(splat_integrator, "RasterOptions", partial(RasterOptions, cutoffs=SMOOTH))
    names = {"color_slopes": 1e-2, "sh_coeffs": 1e-2, "means": 1e-3, "log_scales": 1e-3, "quats": 1e-3}
    gradients = film_gradients(scene_of(MODEL, CAMERA), names, ADJOINT)
    rng = np.random.default_rng(1)
    along = {name: rng.choice([-1.0, 1.0], gradient.shape) for name, gradient in gradients.items()}

    def loss(name: str, distance: float) -> float:
        changed = Splats(**vars(MODEL))
        setattr(changed, name, (getattr(MODEL, name) + distance * along[name]).astype(np.float32))
        return float((picture(changed).astype(float) * ADJOINT).sum())

    for name, step in names.items():
        expected = (loss(name, step) - loss(name, -step)) / (2 * step)
        scale = float(np.abs(gradients[name]).max())
        assert scale > 0.01
        assert (gradients[name] * along[name]).sum() == pytest.approx(expected, abs=0.01 * scale, rel=0.01), name

    scene, params = traversed()
    for name in names:
        dr.enable_grad(params[f"splats.{name}"])
        dr.set_grad(params[f"splats.{name}"], mi.TensorXf(along[name].astype(np.float32)))
    params.update()
    change = scene.integrator().render_forward(scene, params).numpy()
    expected = sum((gradients[name] * along[name]).sum() for name in names)
    assert (change * ADJOINT).sum() == pytest.approx(expected, rel=2e-3)


def test_gradients_with_cutoffs_equal_differences_in_float64():
    splats, adjoint = varying(10, seed=4), ADJOINT.astype(np.float32)
    got = film_gradients(scene_of(splats, CAMERA), (*RAW, *RAW_DOG, "color_slopes"), ADJOINT)
    image, step = reference.render(splats, CAMERA)[0], 1e-6
    curve = (to_linear(image + step) - to_linear(image - step)) / (2 * step)
    assert_gradients_equal(got, reference.loss_gradients(splats, CAMERA, adjoint * curve, smooth=False, eps=1e-7))


def test_adam_finds_them():
    target = mi.render(scene_of(MODEL, CAMERA))
    start = Splats(**(vars(MODEL) | {"color_slopes": 0 * MODEL.color_slopes}))
    errors = errors_of_adam(scene_of(start, CAMERA), ["color_slopes"], target)
    assert errors[-1] < 0.1 * errors[0]


def test_updates_change_values_and_rows_and_may_leave_none():
    scene, params = traversed()
    params["splats.color_slopes"] = params["splats.color_slopes"] * 2
    params.update()
    doubled = Splats(**(vars(MODEL) | {"color_slopes": 2 * MODEL.color_slopes}))
    np.testing.assert_allclose(mi.render(scene).numpy(), picture(doubled), atol=1e-6)

    params["splats.slope_index"] = mi.UInt32([2, 9])
    params["splats.color_slopes"] = mi.TensorXf(MODEL.color_slopes[:2])
    params.update()
    others = Splats(**(vars(MODEL) | {"slope_index": [2, 9], "color_slopes": MODEL.color_slopes[:2]}))
    np.testing.assert_array_equal(mi.render(scene).numpy(), picture(others))

    params["splats.slope_index"] = dr.zeros(mi.UInt32, 0)
    params["splats.color_slopes"] = mi.TensorXf(np.zeros((0, 3, 3), np.float32))
    params.update()
    np.testing.assert_array_equal(mi.render(scene).numpy(), picture(MODEL.without_slopes()))


def test_a_primitive_may_have_slopes_and_any_sh_degree():
    """A group of slopes is no group of an SH degree."""
    scene, params = traversed()
    params["splats.sh_coeffs"] = mi.TensorXf(varying(degree=2).sh_coeffs)
    params["splats.slope_index"] = params["splats.slope_index"]
    params.update()
    assert scene.shapes()[0].sh_size == 9

    mixed = MODEL.with_sh_degrees(np.arange(12) % 2)
    assert np.isin(mixed.slope_index, mixed.sh1_index).any()
    scene, params = traversed(mixed)
    params["splats.sh1_coeffs"] = params["splats.sh1_coeffs"] * 1
    params.set_dirty("splats.slope_index")
    params.update()
    np.testing.assert_allclose(mi.render(scene).numpy(), picture(mixed.uniform_sh()), rtol=1e-5, atol=1e-5)


def test_shapes_with_and_without_are_drawn_as_one_model():
    parts = [varying(9, seed=3).without_slopes(), varying(12), varying(8, seed=5)]
    scene = scene_of(parts[0], CAMERA, extra={f"more_{k}": dog_dict(part) for k, part in enumerate(parts[1:])})
    joined = {name: np.concatenate([getattr(part, name) for part in parts])
              for name in (*RAW, *RAW_DOG, "color_slopes")}
    for name in ("dog_index", "slope_index"):
        joined[name] = np.concatenate([getattr(p, name) + first for p, first in zip(parts, (0, 9, 21), strict=True)])
    np.testing.assert_allclose(mi.render(scene).numpy(), picture(Splats(**joined)), atol=1e-5)


@pytest.mark.parametrize("mirror", [False, True], ids=["turned", "mirrored"])
def test_a_moved_shape_takes_them_along(mirror):
    matrix: Any = np.eye(4)
    matrix[:3, :3] = axis_rotation([1, 2, -1], 0.4)[0] @ np.diag([1, -1 if mirror else 1, 1]) * 1.2
    matrix[:3, 3] = 0.1, 0.2, 0.5
    expected = transformed(MODEL, matrix)
    scene, params = traversed()
    params["splats.to_world"] = mi.Transform4f(matrix)
    params.update()
    images = mi.render(scene).numpy(), picture(MODEL, shape={"to_world": scalar_transform(matrix)}), picture(expected)
    assert np.abs(images[2] - picture(expected.without_slopes())).max() > 0.05
    for image in images[:2]:
        np.testing.assert_allclose(image, images[2], atol=2e-4)
    np.testing.assert_allclose(scene.shapes()[0].to_splats().color_slopes, expected.color_slopes, atol=1e-6)
    dr.enable_grad(params["splats.color_slopes"])
    params.update()
    image = mi.render(scene, params)
    dr.backward(dr.sum(image * mi.TensorXf(ADJOINT.astype(np.float32))))
    at_rest, of_moved = traversed(expected)
    dr.enable_grad(of_moved["splats.color_slopes"])
    of_moved.update()
    dr.backward(dr.sum(mi.render(at_rest, of_moved) * mi.TensorXf(ADJOINT.astype(np.float32))))
    gradient = dr.grad(of_moved["splats.color_slopes"]).numpy() * (-1 if mirror else 1)
    np.testing.assert_allclose(dr.grad(params["splats.color_slopes"]).numpy(), gradient, atol=1e-3)


@pytest.mark.parametrize("linear", [True, False], ids=["linear", "sRGB"])
def test_holdouts_are_black_and_cut_as_much_as_without(linear):
    params, camera, seen = upload(MODEL), DeviceCamera.upload(CAMERA), options(MODEL)
    holdout = np.arange(12) % 3 == 0
    masks = SplatMasks(mi.Bool(np.zeros(12, bool)), mi.Bool(holdout), True)
    shown = masks.shown(params, linear)
    slopes = shown["color_slopes"].numpy().reshape(-1, 9)
    of_holdouts = holdout[MODEL.slope_index]
    assert of_holdouts.any() and not slopes[of_holdouts].any()
    np.testing.assert_array_equal(slopes[~of_holdouts], MODEL.color_slopes.reshape(-1, 9)[~of_holdouts])
    without = masks.shown(upload(MODEL.without_slopes()), linear)
    np.testing.assert_array_equal(masks.hole(shown, camera, seen, None), masks.hole(without, camera, seen, None))


def test_ellipsoids_are_without_them_and_that_is_said(capfd):
    model = MODEL.plain()
    got, expected = to_ellipsoids(model), to_ellipsoids(model.without_slopes())
    assert f"left out the slopes of {MODEL.n_slopes} primitives" in "".join(capfd.readouterr())
    for name in ("centers", "sh_coeffs"):
        np.testing.assert_array_equal(got[name].numpy(), expected[name].numpy())


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"slope_index": np.arange(3)}, r'"color_slopes" has shape \(\d, 3, 3\), expected \(3, 3, 3\) to match'),
        ({"slope_index": MODEL.slope_index[::-1]}, '"slope_index" is not strictly increasing'),
        ({"slope_index": MODEL.slope_index + 6}, '"slope_index" names primitive'),
        ({"color_slopes": MODEL.color_slopes[:, :2]}, r'"color_slopes" has shape \(\d, 2, 3\)'),
    ],
)
def test_updates_that_do_not_fit_are_refused(changes, problem):
    params: Any = mi.traverse(mi.load_dict(dog_dict(MODEL)))
    for name, values in changes.items():
        params[name] = mi.UInt32(values.astype(np.uint32)) if name == "slope_index" else mi.TensorXf(values)
    with pytest.raises(RuntimeError, match=problem):
        params.update()


def test_tensors_that_do_not_fit_are_refused_at_load():
    short = {**dog_dict(MODEL), "color_slopes": mi.TensorXf(MODEL.color_slopes[:1])}
    with pytest.raises(RuntimeError, match=f'"color_slopes" has 1 rows, "slope_index" has {MODEL.n_slopes}'):
        mi.load_dict(short)
