"""What integrators make of primitives whose place depends on the view: pictures, derivatives, masks and lamps."""

from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from film_derivatives import errors_of_adam, film_gradients
from mi_dogsplat import Splats, reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import RAW, RAW_DOG, upload
from mi_dogsplat.plugin import splat_integrator
from mi_dogsplat.plugin.camera_masks import SplatMasks
from mi_dogsplat.plugin.splat_lamps import lamps_of
from mi_dogsplat.scene.mitsuba_cameras import opencv_w2c_to_mitsuba_c2w
from mi_dogsplat.scene.row_groups import SHIFTS
from own_axes_models import ADJOINT, CAMERA, KINDS, SLOPED, picture, traversed
from shifted_models import places_seen, standing, with_shifts
from splat_scenes import (
    assert_gradients_equal,
    dog_dict,
    image_of,
    make_splats,
    options,
    rasterized,
    rounded,
    scene_of,
    sensor_dict,
    to_linear,
)

from benchmarks.numerics.moved_cameras import device_motion, posed


def shifted(n=12, seed=1) -> Splats:
    """Large ones, rather opaque and bright, of which each second one has a shift."""
    return with_shifts(SLOPED.without(SLOPED.random(n, seed)))


def test_pictures_are_those_of_the_engine_and_dogpath_has_the_same():
    model = shifted()
    ours = picture(model, srgb_primitives=False)
    np.testing.assert_allclose(ours, image_of(rasterized(model, CAMERA), CAMERA), atol=1e-5)
    assert np.abs(ours - picture(model.without_shifts(), srgb_primitives=False)).max() > 0.05
    np.testing.assert_array_equal(picture(model, type="dogpath"), picture(model))


@pytest.mark.parametrize("kinds", [(), KINDS], ids=["shifts", "all on one primitive"])
def test_gradients_through_the_film_equal_differences_in_float64(kinds):
    splats, adjoint = shifted(10, seed=4), ADJOINT.astype(np.float32)
    for kind in kinds:
        splats = kind.having(splats)
    names = (*RAW, *RAW_DOG, *SHIFTS.names, *(kind.name for kind in kinds))
    got = film_gradients(scene_of(splats, CAMERA), names, ADJOINT)
    image, step = reference.render(splats, CAMERA)[0], 1e-6
    curve = (to_linear(image + step) - to_linear(image - step)) / (2 * step)
    assert_gradients_equal(got, reference.loss_gradients(splats, CAMERA, adjoint * curve, smooth=False, eps=1e-7))


def test_forward_mode_through_the_film_is_the_transpose_of_reverse_mode():
    model, rng = shifted(), np.random.default_rng(1)
    gradients = film_gradients(scene_of(model, CAMERA), SHIFTS.names, ADJOINT)
    scene, params = traversed(model)
    along = {name: rng.normal(size=gradient.shape).astype(np.float32) for name, gradient in gradients.items()}
    for name, tangent in along.items():
        dr.enable_grad(params[f"splats.{name}"])
        dr.set_grad(params[f"splats.{name}"], mi.TensorXf(tangent))
    params.update()
    change = scene.integrator().render_forward(scene, params).numpy()
    expected = sum((gradients[name] * along[name]).sum() for name in SHIFTS.names)
    assert (change * ADJOINT).sum() == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("aovs", ["", "depth"])
def test_derivatives_by_the_pose_of_the_sensor_equal_differences(monkeypatch, aovs):
    """A camera that moves sees primitives elsewhere; without cutoffs no alpha appears at once.

    A depth is divided by alpha, and so it counts where that is neither small nor of a pseudo-Gaussian.
    """
    monkeypatch.setattr(splat_integrator, "RasterOptions", partial(RasterOptions, cutoffs=SMOOTH))
    model = shifted().plain() if aovs else shifted()
    adjoint = np.random.default_rng(2).normal(size=(12, 16, 3 + bool(aovs))).astype(np.float32)
    adjoint[:, :, 3:] *= (rasterized(model, CAMERA).T.numpy() < 0.7).reshape(12, 16, 1)
    motion = [mi.Float(0) for _ in range(6)]
    dr.enable_grad(motion)
    scene: Any = scene_of(model, CAMERA, aovs=aovs)
    params: Any = mi.traverse(scene)
    base: Any = mi.Transform4f(mi.ScalarTransform4f(opencv_w2c_to_mitsuba_c2w(CAMERA.w2c)).matrix)
    params["sensor.to_world"] = base @ device_motion(motion)
    params.update()
    dr.backward(dr.sum(mi.render(scene, params) * mi.TensorXf(adjoint), axis=None))
    found = np.array([dr.grad(value).numpy()[0] for value in motion])

    def loss(step: np.ndarray, model: Splats) -> float:
        moved = scene_of(model, posed(CAMERA, step), aovs=aovs)
        return float((mi.render(moved).numpy().astype(float) * adjoint).sum())

    def differences(model: Splats, size=2e-3) -> np.ndarray:
        return np.array([(loss(size * e, model) - loss(-size * e, model)) / (2 * size) for e in np.eye(6)])

    expected, scale = differences(model), np.abs(found).max()
    np.testing.assert_allclose(found, expected, atol=0.01 * scale)
    assert np.abs(expected - differences(model.without_shifts())).max() > 0.05 * scale


def test_derivatives_by_to_world_of_the_shape_equal_differences(monkeypatch):
    monkeypatch.setattr(splat_integrator, "RasterOptions", partial(RasterOptions, cutoffs=SMOOTH))
    scene, params = traversed(shifted())
    adjoint, step = mi.TensorXf(ADJOINT.astype(np.float32)), 2e-3

    def loss(θ: mi.Float, flip: int) -> Any:
        T4: Any = mi.Transform4f()
        turn = T4.rotate(mi.Vector3f(0.6, 0, 0.8), 50 * θ) @ T4.scale(mi.Point3f(flip, 1, 1))
        params["splats.to_world"] = T4.scale(mi.Point3f(1.1 + θ)) @ turn
        params.update()
        return dr.sum(mi.render(scene, params) * adjoint)

    for flip in (1, -1):
        θ = mi.Float(0)
        dr.enable_grad(θ)
        dr.backward(loss(θ, flip))
        sides = [float(loss(mi.Float(sign * step), flip).array[0]) for sign in (1, -1)]
        expected = (sides[0] - sides[1]) / (2 * step)
        assert abs(expected) > 1
        assert dr.grad(θ)[0] == pytest.approx(expected, rel=0.01)


def test_adam_finds_them():
    """From zeros, as training starts."""
    model = shifted()
    start = Splats(**{**vars(model), "view_shifts": 0 * model.view_shifts})
    target = mi.render(scene_of(model, CAMERA))
    errors = errors_of_adam(scene_of(start, CAMERA), ["view_shifts"], target, step_size=0.05)
    assert errors[-1] < 0.1 * errors[0]


def test_holdouts_cover_what_they_do_where_they_are_seen():
    model, camera = shifted(), DeviceCamera.upload(CAMERA)
    masks = SplatMasks(mi.Bool(np.zeros(12, bool)), mi.Bool(np.ones(12, bool)), True)
    hole, of_still = (masks.hole(masks.shown(upload(splats), True), camera, options(splats), None).numpy()
                      for splats in (model, model.without_shifts()))
    np.testing.assert_allclose(hole, 1 - rasterized(model, CAMERA).T.numpy(), atol=1e-5)
    assert np.abs(hole - of_still).max() > 0.05


def test_lamps_are_aimed_at_where_they_are_stored():
    splats = rounded(make_splats(np.arange(12).reshape(4, 3), colors=np.array([[30.0], [1], [1], [40]])))
    splats = with_shifts(splats)
    lamps, of_still = (lamps_of(upload(model), linear=True) for model in (splats, splats.without_shifts()))
    assert lamps and of_still
    np.testing.assert_array_equal(np.array(lamps.center), np.array(of_still.center))


def test_a_mirror_shows_them_where_its_rays_see_them():
    """Parallel rays of an orthographic camera run on as parallel rays behind a mirror, so that a model which stands
    where these see it has the same picture."""
    T4: Any = mi.ScalarTransform4f()
    behind = rounded(make_splats([[0.2, 0.1, -1.0], [-0.3, -0.2, -1.5]], 0.25, 0.8, [[0.9, 0.4, 0.2], [0.2, 0.6, 0.8]]))
    model = with_shifts(behind, every=1)
    sensor = {**sensor_dict(CAMERA), "type": "orthographic", "to_world": T4.rotate([0, 1, 0], 0).scale([1, 1, 1]),
              "near_clip": 0.01}
    for name in ("fov", "fov_axis", "principal_point_offset_x", "principal_point_offset_y"):
        sensor.pop(name, None)
    mirror = {"type": "rectangle", "to_world": T4.translate([0, 0, 3]).rotate([0, 1, 0], 180).scale(9),
              "bsdf": {"type": "conductor"}}

    def seen(splats: Splats) -> np.ndarray:
        integrator = {"type": "dogpath", "max_depth": 3, "srgb_primitives": False}
        scene: Any = {"type": "scene", "integrator": integrator, "sensor": sensor, "splats": dog_dict(splats),
                      "mirror": mirror, "sky": {"type": "constant", "radiance": 0.2}}
        return np.array(mi.render(mi.load_dict(scene), spp=1))  # pyright: ignore

    back = np.array([0.0, 0, -1])
    image, of_still = seen(model), seen(standing(model, back))
    assert np.abs(places_seen(model, back[None])[:, 0] - model.means).max() > 0.1
    np.testing.assert_allclose(image, of_still, atol=1e-4)
    assert np.abs(image - seen(model.without_shifts())).max() > 0.05
