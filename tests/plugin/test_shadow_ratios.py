"""``mesh_shadows`` of ``dogpath``: shadows of surfaces on splats against brute force in float64, and what they keep."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.plugin import shadow_ratios
from mi_dogsplat.plugin.shadow_ratios import ShadowRatios, estimated
from mi_dogsplat.scene.cameras import Camera
from same_numbers import assert_same_numbers
from splat_scenes import make_splats, random_splats, rounded, scene_of

CAMERA = Camera(np.eye(4), 18.0, 18.0, 6.0, 5.0, 12, 10)  # at the origin, looks along z
T4 = mi.ScalarTransform4f
FLAT = [0.3, 0.3, 0.01]  # in a plane of constant z
PLACES = [[0.0, 0, 0], [0.7, 0.2, 0], [-2.0, 1.0, 0.4]]


def diffuse(reflectance: float) -> dict[str, Any]:
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": reflectance}}}


def square(to_world: Any, reflectance=0.0, **others: Any) -> dict[str, Any]:
    return {"type": "rectangle", "to_world": to_world, "bsdf": diffuse(reflectance), **others}


def ratios_of(splats: Any, others: dict[str, Any], samples: int, max_depth=2) -> ShadowRatios:
    scene = mi.load_dict({"type": "scene", **others})
    return estimated(scene, upload(rounded(splats)), max_depth, samples)


def upper(ratios: ShadowRatios) -> np.ndarray:
    """[N, 3] on the sides that look along z."""
    up = np.array(ratios.axis[2]) > 0
    return np.where(up[:, None], np.transpose(ratios.front), np.transpose(ratios.back))


def mean_ratios(others: dict[str, Any], max_depth=2) -> np.ndarray:
    """[3, 3] of discs at ``PLACES``, on the sides that look along z: means over many with numbers of their own."""
    ratios = ratios_of(make_splats(np.repeat(PLACES, 16, 0), FLAT), others, 256, max_depth)
    return upper(ratios).reshape(len(PLACES), -1, 3).mean(1)


def hemisphere(n: int) -> np.ndarray:
    """[n n, 3] directions with z > 0, by their cosine."""
    u, v = (np.mgrid[0:n, 0:n].reshape(2, -1) + 0.5) / n
    r, phi = np.sqrt(u), 2 * np.pi * v
    return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - u)], -1)


def inside(points: np.ndarray, middle: Any, half: float) -> np.ndarray:
    """Whether points of its plane lie in a square."""
    return np.abs(points[..., :2] - np.asarray(middle)).max(-1) < half


@pytest.mark.parametrize("reflectance, max_depth", [(0.0, 2), (0.6, 3)])
def test_a_square_takes_the_sky_behind_it_and_sends_back_what_it_reflects(reflectance, max_depth):
    """Under a constant environment a square's radiance is its reflectance times that."""
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": [0.5, 1, 2]}}
    got = mean_ratios({"square": square(T4().translate([0.2, 0, 1]).scale(0.8), reflectance), "sky": sky}, max_depth)
    w = hemisphere(600)
    covered = [inside(np.array(p) + w * (1 - p[2]) / w[:, 2:], (0.2, 0), 0.8).mean() for p in PLACES]
    expected = 1 - np.array(covered) * (1 - reflectance)
    assert expected.min() < 0.85 and expected.max() > 0.95
    np.testing.assert_allclose(got, np.repeat(expected[:, None], 3, 1), atol=0.01)


def test_half_a_lamp_gives_the_half_shade_of_quadrature():
    lamp = {"type": "rectangle", "to_world": T4().translate([0, 0, 3]).rotate([1, 0, 0], 180),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [4, 2, 1]}}}
    got = mean_ratios({"square": square(T4().translate([0.8, 0, 1]).scale(0.8)), "lamp": lamp})
    x, y = (np.mgrid[0:500, 0:500].reshape(2, -1) + 0.5) / 250 - 1
    expected = []
    for p in np.array(PLACES):
        d = np.stack([x, y, np.full_like(x, 3)], -1) - p
        weight = d[:, 2] ** 2 / (d**2).sum(-1) ** 2  # two cosines over the square of the distance
        hidden = inside(p + d * ((1 - p[2]) / d[:, 2:]), (0.8, 0), 0.8)
        expected.append(1 - (weight * hidden).sum() / weight.sum())
    assert min(expected) < 0.4
    np.testing.assert_allclose(got, np.repeat(np.array(expected)[:, None], 3, 1), atol=0.01)


def test_the_ratio_of_a_point_light_is_one_or_zero_and_that_of_two_is_by_colour():
    places = [[0.0, 0, 0], [3.0, 0, 0]]
    red, blue = ({"type": "point", "position": [x, 0, 2], "intensity": {"type": "rgb", "value": value}}
                 for x, value in ((0, [8, 0, 0]), (3, [0, 0, 8])))
    over_first = square(T4().translate([0, 0, 1]).scale(0.1))
    got = upper(ratios_of(make_splats(places, FLAT), {"square": over_first, "red": red, "blue": blue}, 2))
    np.testing.assert_array_equal(got, [[0, 1, 1], [1, 1, 1]])  # no light is green: nothing is taken of it


def test_ratios_are_one_where_nothing_hides_light_and_never_more():
    bright = square(T4().translate([0, 0, -0.1]).scale(30), 1.0)
    sky = {"type": "constant"}
    above = upper(ratios_of(make_splats(PLACES, FLAT), {"floor": bright, "sky": sky}, 3, 4))
    np.testing.assert_array_equal(above, 1)
    around = {"floor": square(T4().translate([0, 0, -0.1]).scale(2), 1.0), "sky": sky,
              "lamp": {"type": "point", "position": [0.0, 0, -1]}}
    ratios = ratios_of(random_splats(30, degree=0), around, 4, 6)
    both = np.array([*ratios.front, *ratios.back])
    assert both.max() == 1 and both.min() >= 0 and both.min() < 0.7


def test_without_light_and_without_place_nothing_is_taken():
    splats = make_splats([[0.0, 0, 0], [np.nan, 0, 0]], FLAT)
    roof = square(T4().translate([0, 0, 1]).scale(5))
    for others in ({}, {"sky": {"type": "constant"}}):
        ratios = estimated(mi.load_dict({"type": "scene", "roof": roof, **others}), upload_with(splats), 2, 4)
        assert np.isfinite(np.array(ratios.front)).all()
        assert others or (np.array([ratios.front, ratios.back]) == 1).all()


def upload_with(splats: Any) -> dict:
    """As a training that has gone wrong leaves them: no file has a NaN."""
    params = upload(rounded(make_splats(np.nan_to_num(splats.means), FLAT)))
    return params | {"means": mi.Float(splats.means.astype(np.float32).ravel())}


def test_a_camera_sees_the_ratio_of_its_side():
    splats = rounded(make_splats([[0.0, 0, 3]], FLAT))
    others = {"roof": square(T4().translate([0, 0, 3.1]).scale(50)), "sky": {"type": "constant"}}
    ratios = ratios_of(splats, others, 16)
    w2c = np.diag([1.0, -1, -1, 1])
    w2c[2, 3] = 6  # looks back from z = 6
    away = Camera(w2c, 18.0, 18.0, 6.0, 5.0, 12, 10)
    seen = [np.array(ratios.seen_by(DeviceCamera.upload(c), upload(splats))).ravel() for c in (CAMERA, away)]
    np.testing.assert_allclose(seen[0], 1, atol=1e-6)
    assert seen[1].max() < 0.05


# In the integrator

SURROUNDINGS = {"floor": square(T4().translate([0, 1.0, 0]).rotate([1, 0, 0], 90).scale(9), 0.4),
                "sky": {"type": "constant"}}


def lit_scene(splats: Any, others: dict[str, Any] | None = None, max_depth=3, **integrator) -> Any:
    how = {"type": "dogpath", "max_depth": max_depth, **integrator}
    return scene_of(rounded(splats), CAMERA, extra=others or SURROUNDINGS, **how)


@pytest.mark.parametrize("linear", [True, False], ids=["linear", "sRGB"])
def test_a_model_that_is_shaded_evenly_sends_that_share_of_its_light(linear):
    """A black wall beside half of the sky: round about half is left to discs that face the camera."""
    splats = make_splats([[0.3, 0, 2.0], [-0.3, 0.1, 2.2]], [0.5, 0.5, 0.001], 0.9, [[0.9, 0.5, 0.2], [0.3, 0.6, 0.8]])
    lamps = {side: {"type": "point", "position": [x, 0.0, -1], "intensity": {"type": "rgb", "value": 9}}
             for side, x in (("left", -40), ("right", 40))}
    wall = {"wall": square(T4().translate([9, 0, 0]).rotate([0, 1, 0], 90).scale(5)), **lamps}
    how = {"srgb_primitives": not linear, "mesh_shadow_samples": 64}
    shaded, full = (np.array(mi.render(lit_scene(splats, wall, mesh_shadows=on, **how), spp=1)) for on in (True, False))
    bright = full > 0.02
    assert bright.mean() > 0.5
    np.testing.assert_allclose(shaded[bright] / full[bright], 0.5, atol=0.025)


def test_it_is_off_by_default_and_then_asks_for_nothing(monkeypatch):
    splats = random_splats(12, degree=1)
    shaded = np.array(mi.render(lit_scene(splats, mesh_shadows=True), spp=1))
    said = np.array(mi.render(lit_scene(splats, mesh_shadows=False), spp=1))
    monkeypatch.setattr(shadow_ratios, "estimated", None)
    monkeypatch.setattr(shadow_ratios, "what_matters", None)
    default = np.array(mi.render(lit_scene(splats), spp=1))
    np.testing.assert_array_equal(default, said)
    assert np.abs(shaded - default).max() > 0.02
    alone = scene_of(rounded(splats), CAMERA, type="dogpath", mesh_shadows=True)  # no surface, no shadow
    assert isinstance(mi.render(alone, spp=1), mi.TensorXf)


@pytest.mark.parametrize("linear", [True, False], ids=["linear", "sRGB"])
def test_where_nothing_hides_light_the_bits_are_the_same(linear):
    others = {"ball": {"type": "sphere", "center": [0.0, 0, 9], "radius": 2.0, "bsdf": diffuse(0.5)},
              "lamp": {"type": "point", "position": [0.0, 0, -3]}}
    on, off = (np.array(mi.render(lit_scene(random_splats(12, degree=1), others, mesh_shadows=shadows,
                                            srgb_primitives=not linear), spp=1)) for shadows in (True, False))
    assert_same_numbers(on, off)


@pytest.mark.parametrize("max_depth, same_as, other", [(-1, 60, 2), (0, 1, -1)])
def test_light_paths_without_limit_and_without_segments(max_depth, same_as, other):
    """A path along which a floor and a roof reflect light 60 times brings none any more."""
    facing = {"floor": square(T4().translate([0, 0, -0.1]).scale(2), 0.8),
              "roof": square(T4().translate([0, 0, 1]).scale(0.8), 0.8), "sky": {"type": "constant"}}
    same, expected, more_or_less = (upper(ratios_of(make_splats(PLACES, FLAT), facing, 16, depth))
                                    for depth in (max_depth, same_as, other))
    np.testing.assert_allclose(same, expected, atol=1e-4)
    assert np.abs(same - more_or_less).max() > 0.05


@pytest.mark.parametrize("max_depth, same_as", [(-1, 60), (2**31 - 1, 60), (0, 0)])
def test_a_picture_without_limit_or_segments_has_shadows_too(max_depth, same_as):
    splats = random_splats(12, degree=1)
    got, expected = (np.array(mi.render(lit_scene(splats, max_depth=depth, mesh_shadows=True), spp=1))
                     for depth in (max_depth, same_as))
    np.testing.assert_allclose(got, expected, atol=1e-4)
    assert np.abs(got - np.array(mi.render(lit_scene(splats, max_depth=same_as), spp=1))).max() > 0.02


def test_ratios_are_estimated_again_only_after_a_change_that_matters(monkeypatch):
    calls, real = [], shadow_ratios.estimated

    def counted(*args: Any) -> ShadowRatios:
        calls.append(args)
        return real(*args)

    monkeypatch.setattr(shadow_ratios, "estimated", counted)
    group = {"type": "shapegroup", "leaf": square(T4().translate([0, -1.2, 0]))}
    instance = {"type": "instance", "group": {"type": "ref", "id": "group"}}
    others = {**SURROUNDINGS, "group": group, "instance": instance}
    scene = lit_scene(random_splats(5, degree=0), others, mesh_shadows=True, mesh_shadow_samples=2)
    params: Any = mi.traverse(scene)

    def after(name: str, value: Any) -> int:
        params[name] = value
        params.update()
        mi.render(scene, spp=2)
        return len(calls)

    assert after("splats.sh_coeffs", params["splats.sh_coeffs"] * 0.5) == 1
    assert after("splats.logit_opacities", params["splats.logit_opacities"] + 1) == 1
    assert after("splats.means", params["splats.means"] + 0.1) == 2
    assert after("floor.to_world", T4().translate([0, 1.2, 0]).rotate([1, 0, 0], 90).scale(9)) == 3
    assert after("sky.radiance.value", mi.Float(2)) == 4
    assert after("sensor.x_fov", mi.Float(40)) == 4
    assert after("instance.to_world", T4().translate([0.5, 0, 0])) == 5
    assert after("group.leaf.to_world", T4().translate([0, -1, 0])) == 6
    assert after("group.leaf.bsdf.brdf_0.reflectance.value", mi.Color3f(0.4)) == 7


def test_derivatives_of_colours_are_exact_behind_ratios():
    """In linear colours the picture is linear in them, up to where they are 0."""
    splats = random_splats(8, degree=1, seed=7)
    splats.sh_coeffs *= 0.3
    scene = lit_scene(splats, mesh_shadows=True, srgb_primitives=False, mesh_shadow_samples=4)
    params: Any = mi.traverse(scene)
    name, seed = "splats.sh_coeffs", 3
    adjoint = np.random.default_rng(0).normal(size=(10, 12, 3)).astype(np.float32)
    direction = np.random.default_rng(1).normal(size=params[name].shape).astype(np.float32)
    values = params[name].numpy()
    sides = []
    for step in (0.02, -0.02):
        params[name] = mi.TensorXf(values + step * direction)
        params.update()
        sides.append((np.array(mi.render(scene, spp=2, seed=seed), float) * adjoint).sum())  # type: ignore[arg-type]
    params[name] = mi.TensorXf(values)
    dr.enable_grad(params[name])
    params.update()
    scene.integrator().render_backward(scene, params, mi.TensorXf(adjoint), seed=seed, spp=2)
    got = (dr.grad(params[name]).numpy() * direction).sum()
    assert got == pytest.approx((sides[0] - sides[1]) / 0.04, rel=0.01)


def test_a_wrong_number_of_samples_is_refused():
    with pytest.raises(RuntimeError, match='"mesh_shadow_samples" is 0'):
        mi.load_dict({"type": "dogpath", "mesh_shadow_samples": 0})
