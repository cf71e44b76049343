"""Captured lamps of ``dogpath``: sampling their directions changes noise, and no mean."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.plugin import dogpath
from mi_dogsplat.plugin.splat_lamps import BRIGHT, MOST, lamps_of
from mi_dogsplat.scene.cameras import Camera
from splat_scenes import make_splats, random_splats, rounded, scene_of, to_srgb

CAMERA = Camera(np.eye(4), 360.0, 360.0, 120.0, 100.0, 240, 200)  # at the origin, looks along z
T4 = mi.ScalarTransform4f
# a small lamp and a DoG one, both beside the view, and something dark in front of one of them
LAMPS: dict[str, Any] = {"means": [[1.2, 0, 2.5], [-1.5, 0.4, 2.0], [0.8, 0, 3.0]], "opacities": 0.9,
                         "scales": [[0.1] * 3, [0.2] * 3, [0.3] * 3], "dog": [1], "f_a": 0.3, "F": 1.3}
RADIANCE = np.array([[30.0, 20, 10], [10, 20, 30], [0.05, 0.05, 0.05]])


def lit_scene(bsdf: dict[str, Any], linear=True) -> Any:
    splats = make_splats(colors=RADIANCE if linear else to_srgb(RADIANCE), **LAMPS)
    walls = {"wall": {"type": "rectangle", "to_world": T4().translate([0, 0, 4]).rotate([0, 1, 0], 180).scale(9),
                      "bsdf": bsdf},
             "floor": {"type": "rectangle", "to_world": T4().translate([0, 1.5, 0]).rotate([1, 0, 0], 90).scale(9)}}
    return scene_of(rounded(splats), CAMERA, extra=walls, type="dogpath", max_depth=4, srgb_primitives=not linear)


@pytest.mark.parametrize("linear, bsdf", [
    (True, {"type": "diffuse"}), (False, {"type": "roughplastic", "alpha": 0.2}), (True, {"type": "plastic"}),
], ids=["diffuse", "glossy, sRGB", "with a mirror image"])
def test_their_sampling_changes_no_mean_and_less_noise_is_left(linear, bsdf, monkeypatch):
    """Four times the samples of BSDF sampling alone have a mean that is known to some 2 %."""
    sought = np.array(mi.render(lit_scene(bsdf, linear), spp=2))
    monkeypatch.setattr(dogpath, "lamps_of", lambda params, linear: None)
    found = np.array(mi.render(lit_scene(bsdf, linear), spp=8))
    np.testing.assert_allclose(sought.mean((0, 1)), found.mean((0, 1)), rtol=0.08)
    assert rough(sought) < rough(found)


def rough(image: np.ndarray) -> float:
    """Mean of the squared differences of neighbours, which the noise makes."""
    return float(np.mean(np.diff(image.mean(-1), axis=1) ** 2))


@pytest.mark.parametrize("p", [[0.0, 0, 0], [1.2, 0, 2.45], [200.0, 0, 0]], ids=["away", "within", "far away"])
def test_the_density_is_one_in_all_and_that_of_the_samples(p):
    splats = rounded(make_splats(colors=RADIANCE, **LAMPS))
    lamps = lamps_of(upload(splats), linear=True)
    assert lamps and len(lamps.center) == 2
    n = 200_000
    points = mi.Point3f(p) + dr.zeros(mi.Point3f, n)
    generator: Any = mi.PCG32
    rng = generator(n)
    which, place = rng.next_float32(), mi.Point2f(rng.next_float32(), rng.next_float32())
    d, pdf = lamps.sample(points, which, place)
    assert (pdf.numpy() > 0).mean() > 0.999
    np.testing.assert_allclose(dr.norm(d).numpy(), 1, atol=1e-5)
    uniform = lamps.pdf(points, mi.warp.square_to_uniform_sphere(place)).numpy()
    if p[0] < 100:  # else too few fall into the cones
        np.testing.assert_allclose(uniform.mean() * 4 * np.pi, 1, rtol=0.05)
        solid_angle = (1 / np.maximum(pdf.numpy(), 1e-3)).mean()  # of all cones, by importance sampling
        np.testing.assert_allclose((uniform > 0).mean() * 4 * np.pi, solid_angle, rtol=0.05)


def test_no_model_in_display_colours_has_lamps_and_of_many_the_brightest_are_taken():
    assert lamps_of(upload(rounded(random_splats(50, degree=2))), linear=False) is None
    colors = np.full((40, 3), 0.5)
    colors[:20, 1] = BRIGHT + 1 + np.arange(20)
    lamps = lamps_of(upload(rounded(make_splats(np.arange(120).reshape(40, 3), colors=colors))), linear=True)
    assert lamps and len(lamps.center) == MOST
    assert sorted(float(np.array(c).ravel()[0]) for c in lamps.center) == [3.0 * k for k in range(12, 20)]


def test_a_lamp_whose_size_is_beyond_float32_is_none_and_nobody_is_warned():
    splats = rounded(make_splats(colors=RADIANCE, **LAMPS))
    splats.log_scales[0] = 60
    lamps = lamps_of(upload(splats), linear=True)
    assert lamps and len(lamps.center) == 1 and lamps.center[0].numpy().ravel() == pytest.approx(LAMPS["means"][1])


def test_brightness_that_curves_counts_with_its_mean():
    """Of these only the middle of the first and the rim of the second are bright enough; on average the second is."""
    colors = np.full((4, 3), [[BRIGHT + 1], [BRIGHT - 1], [BRIGHT + 1], [BRIGHT - 1]])
    splats = rounded(make_splats([[0, 0, 3], [1, 0, 3], [2, 0, 3], [3, 0, 3]], colors=colors))
    splats.curvature_index = np.array([0, 1, 2], np.uint32)
    splats.brightness_curvatures = np.array([[-6, -6, -6, 9, 9, 9], [6, 6, 6, 0, 0, 0], [3, -3, 0, 30, 30, 30]], "f4")
    lamps, flat = (lamps_of(upload(of), linear=True) for of in (splats, splats.without_curvatures()))
    assert lamps and flat
    for found in (lamps, flat):
        assert sorted(float(np.array(c).ravel()[0]) for c in found.center) == [1, 2]
    np.testing.assert_allclose(np.ravel(lamps.power), np.ravel(flat.power), rtol=1e-5)


def test_derivatives_of_a_lamp_are_those_of_differences():
    """Along one direction, with the same random numbers; its colour and opacity move no direction of a path."""
    splats = make_splats([[1.2, 0, 2.5]], 0.3, 0.9, [[30.0, 20, 10]])
    wall = {"wall": {"type": "rectangle", "to_world": T4().translate([0, 0, 4]).rotate([0, 1, 0], 180).scale(9)}}
    camera = Camera(np.eye(4), 18.0, 18.0, 6.0, 5.0, 12, 10)
    scene: Any = scene_of(rounded(splats), camera, extra=wall, type="dogpath", max_depth=3, srgb_primitives=False)
    params: Any = mi.traverse(scene)
    adjoint = np.random.default_rng(0).uniform(size=(10, 12, 3)).astype(np.float32)
    for name, step in (("splats.sh_coeffs", 0.5), ("splats.logit_opacities", 0.05)):
        values, sides = params[name].numpy(), []
        for sign in (1, -1):
            params[name] = mi.TensorXf(values + np.float32(sign * step))
            params.update()
            sides.append((np.array(mi.render(scene, spp=4), float) * adjoint).sum())
        params[name] = mi.TensorXf(values)
        dr.enable_grad(params[name])
        params.update()
        scene.integrator().render_backward(scene, params, mi.TensorXf(adjoint), spp=4)
        assert dr.grad(params[name]).numpy().sum() == pytest.approx((sides[0] - sides[1]) / (2 * step), rel=0.02)
        dr.disable_grad(params[name])
