"""Derivatives of ``dogpath``, in both modes, equal central differences of renders with the same random numbers."""

from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.plugin import dogpath, splat_integrator
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.mitsuba_cameras import camera_to_mitsuba
from mi_dogsplat.tracing import tracer, tree
from mi_dogsplat.tracing.options import TraceOptions
from read_together import read_gradients
from splat_scenes import make_splats, rounded, scene_of

CAMERA = Camera(np.eye(4), 9.0, 9.0, 3.0, 2.5, 6, 5)
SEED: Any = 1
SPP = 2
T4 = mi.ScalarTransform4f
# two behind the camera, for the mirror; two in front of the wall, one of them in the view and before the other
SPLATS = make_splats([[0.3, 0, -1.0], [-0.4, 0.2, -1.5], [1.5, 0, 2.2], [0, 0, 2.2]], 0.4, [0.6, 0.5, 0.7, 0.5],
                     [[0.9, 0.5, 0.2], [0.2, 0.6, 0.7], [0.5, 0.4, 0.3], [0.3, 0.6, 0.3]], dog=[1, 3], f_a=0.6, F=1.4)
ADJOINT = np.random.default_rng(0).normal(size=(5, 6, 3))
SPLATS.slope_index, SPLATS.color_slopes = np.array([0, 1, 2, 3]), np.random.default_rng(2).normal(0, 0.05, (4, 3, 3))
SPLATS.cut_index, SPLATS.cut_normals = np.array([0, 2, 3]), np.random.default_rng(3).normal(0, 3, (3, 3))
SPLATS.second_cut_index = np.array([1, 2])
# with these, these shifts and this seed no ray sees a mean colour near where ``emitted`` clips it, where no difference
# is a derivative
SPLATS.second_cut_normals = np.random.default_rng(7).normal(0, 3, (2, 3))
SPLATS.curvature_index, SPLATS.brightness_curvatures = [0, 1, 3], np.random.default_rng(8).normal(0, 0.03, (3, 6))
SPLATS.shift_index, SPLATS.view_shifts = [0, 3], np.random.default_rng(11).normal(0, 0.3, (2, 3, 3))
SPLATS.mean_views = np.random.default_rng(10).uniform(-0.5, 0.5, (2, 3))
NAMES = {
    "sh_coeffs": 1e-2,
    "logit_opacities": 1e-2,
    "dog_logit_opacities": 1e-2,
    "color_slopes": 1e-3,
    "brightness_curvatures": 1e-3,
    "cut_normals": 1e-2,
    "second_cut_normals": 1e-2,
    "view_shifts": 1e-3,
    "mean_views": 1e-3,
}


@pytest.fixture(autouse=True)
def _smooth(monkeypatch):
    """No alpha appears at once where a parameter moves."""
    monkeypatch.setattr(dogpath, "TraceOptions", partial(TraceOptions, cutoffs=SMOOTH))
    monkeypatch.setattr(splat_integrator, "RasterOptions", partial(RasterOptions, cutoffs=SMOOTH))


def others(bsdf: dict[str, Any]) -> dict[str, Any]:
    return {
        "wall": {"type": "rectangle", "to_world": T4().translate([0, 0, 3]).rotate([0, 1, 0], 180).scale(9),
                 "bsdf": bsdf},
        "floor": {"type": "rectangle", "to_world": T4().translate([0, 1.5, 0]).rotate([1, 0, 0], 90).scale(9)},
        "light": {"type": "point", "position": [3.0, 0.0, 1.0], "intensity": {"type": "rgb", "value": 9.0}},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 0.7}},
    }


def scene_with(splats: Any, surroundings: dict[str, Any]) -> Any:
    return scene_of(rounded(splats), CAMERA, extra=surroundings, type="dogpath", max_depth=3, rr_depth=20)


def difference(name: str, direction: np.ndarray, surroundings: dict[str, Any]) -> float:
    """Of the loss, along a direction of a parameter in ``NAMES``."""
    values, step, sides = np.array(getattr(SPLATS, name), float), NAMES[name], []
    scene = scene_with(SPLATS, surroundings)
    params: Any = mi.traverse(scene)
    for sign in (1, -1):
        params[f"splats.{name}"] = mi.TensorXf((values + sign * step * direction).astype(np.float32))
        params.update()
        sides.append((np.array(mi.render(scene, spp=SPP, seed=SEED), float) * ADJOINT).sum())
    return float(sides[0] - sides[1]) / (2 * step)


@pytest.mark.slow
@pytest.mark.parametrize("bsdf", [{"type": "conductor"}, {"type": "diffuse"}], ids=["mirror", "shadow"])
def test_gradients_of_splats_in_mirrors_and_of_their_shadows_equal_differences(bsdf, monkeypatch):
    """All passes share one tree over the primitives."""
    built = []
    monkeypatch.setattr(tracer, "build", lambda *args: built.append(args) or tree.build(*args))
    surroundings = others(bsdf)
    scene = scene_with(SPLATS, surroundings)
    params: Any = mi.traverse(scene)
    leaves = {name: params[f"splats.{name}"] for name in NAMES}
    dr.enable_grad(leaves)
    params.update()
    scene.integrator().render_backward(scene, params, mi.TensorXf(ADJOINT.astype(np.float32)), seed=SEED, spp=SPP)
    assert len(built) == 1
    gradients = read_gradients(leaves, leaves)
    rng = np.random.default_rng(1)
    for name, gradient in gradients.items():
        scale = float(np.abs(gradient).max())
        assert scale > 0.01, name
        for direction in rng.choice([-1.0, 1.0], (2, *gradient.shape)):  # every entry counts as much as it is large
            expected = difference(name, direction, surroundings)
            assert (gradient * direction).sum() == pytest.approx(expected, abs=0.01 * scale, rel=0.02), name

    direction = {name: rng.normal(size=g.shape).astype(np.float32) for name, g in gradients.items()}
    scene = scene_with(SPLATS, surroundings)
    params = mi.traverse(scene)
    for name in NAMES:
        dr.enable_grad(params[f"splats.{name}"])
        dr.set_grad(params[f"splats.{name}"], mi.TensorXf(direction[name]))
    params.update()
    change = np.array(scene.integrator().render_forward(scene, params, seed=SEED, spp=SPP))
    along = sum((gradients[name] * direction[name]).sum() for name in NAMES)
    assert (change * ADJOINT).sum() == pytest.approx(along, rel=2e-3)


@pytest.mark.slow
def test_materials_and_lights_have_derivatives_though_no_primitive_has():
    scene = scene_with(SPLATS, others({"type": "diffuse"}))
    params: Any = mi.traverse(scene)
    names = ["wall.bsdf.reflectance.value", "light.intensity.value"]
    dr.enable_grad([params[name] for name in names])
    params.update()
    scene.integrator().render_backward(scene, params, mi.TensorXf(ADJOINT.astype(np.float32)), seed=SEED, spp=SPP)
    gradients = {name: np.array(dr.grad(params[name])).ravel() for name in names}
    for name in names:
        sides = []
        for factor in (1.02, 0.98):  # of all channels together
            changed = others({"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.5 * factor] * 3}}
                             if name.startswith("wall") else {"type": "diffuse"})
            if name.startswith("light"):
                changed["light"] |= {"intensity": {"type": "rgb", "value": [9 * factor] * 3}}
            sides.append((np.array(mi.render(scene_with(SPLATS, changed), spp=SPP, seed=SEED), float) * ADJOINT).sum())
        at = 0.5 if name.startswith("wall") else 9
        assert gradients[name].sum() == pytest.approx((sides[0] - sides[1]) / (0.04 * at), rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("computed", [False, True], ids=["itself", "from another"])
@pytest.mark.parametrize("first", ["wall", "floor"])
@pytest.mark.parametrize("name", ["wall.bsdf.reflectance.value", "floor.bsdf.reflectance.value", "sky.radiance.value",
                                  "wall.bsdf.reflectance.data"])  # fmt: skip
def test_both_modes_agree_on_parameters_of_the_scene(name, first, computed):
    """Every segment and every pass meets them, in calls of several BSDFs, and their tangent may come from elsewhere.

    Of ``data`` a texture keeps a copy that is padded to four channels: each segment needs the tangents of that.
    """
    reflectance: dict[str, Any] = {"type": "rgb", "value": 0.4}
    if name.endswith("data"):
        texels = np.random.default_rng(4).uniform(0.2, 0.8, (4, 5, 3)).astype(np.float32)
        reflectance = {"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": True}
    surroundings = others({"type": "diffuse", "reflectance": reflectance})
    scene = scene_with(SPLATS, {first: surroundings.pop(first), **surroundings})
    params: Any = mi.traverse(scene)
    value = type(params[name])(params[name])

    def rendered() -> tuple[Any, mi.TensorXf]:
        source = mi.Float(0) if computed else type(value)(value)
        dr.enable_grad(source)
        params[name] = value + source if computed else source
        params.update()
        image = mi.render(scene, params, spp=SPP, seed=SEED, seed_grad=SEED + 1)
        return source, image * mi.TensorXf(ADJOINT.astype(np.float32))

    source, image = rendered()
    dr.backward(dr.sum(image, axis=None))
    backward = np.array(dr.grad(source)).sum()
    source, image = rendered()
    dr.forward(source)
    np.testing.assert_allclose(dr.grad(image).numpy().sum(), backward, rtol=1e-4)
    source, image = rendered()
    dr.set_grad(source, 1)
    np.testing.assert_allclose(dr.forward_to(image).numpy().sum(), backward, rtol=1e-4)


def test_forward_mode_by_a_sensor_that_is_not_of_the_scene():
    """Nothing that the paths meet is attached."""
    scene = scene_with(SPLATS, others({"type": "diffuse"}))
    sensor: Any = mi.load_dict(camera_to_mitsuba(CAMERA))
    params: Any = mi.traverse(sensor)
    shift = mi.Float(0)
    dr.enable_grad(shift)
    params["to_world"] = params["to_world"] @ mi.Transform4f().translate([shift, 0, 0])
    params.update()
    image = mi.render(scene, params, sensor=sensor, spp=SPP, seed=SEED)
    dr.forward(shift)
    assert np.abs(dr.grad(image).numpy()).max() > 1e-3
