"""``dogpath``: shadows, mirror images and refractions of splats against brute force in float64, and what it keeps."""

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat.plugin import light_paths
from mi_dogsplat.plugin.dogpath import LatestTracer
from mi_dogsplat.reference import rays as twin
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.tracing.options import TraceOptions
from splat_scenes import (
    dog_dict,
    fine,
    make_splats,
    random_splats,
    rounded,
    scene_of,
    sensor_dict,
    to_linear,
    variable_in_the_place_of,
)

CAMERA = Camera(np.eye(4), 18.0, 18.0, 6.0, 5.0, 12, 10)  # at the origin, looks along z
ALONE = {"type": "dogpath"}
T4 = mi.ScalarTransform4f


def render(splats: Any, others: dict[str, Any], spp=1, film: dict | None = None, seed=0, camera=CAMERA,
           **integrator) -> np.ndarray:
    scene = mi.load_dict({"type": "scene", "integrator": {"type": "dogpath", **integrator},
                          "sensor": sensor_dict(camera, **(film or {})), "splats": dog_dict(rounded(splats)), **others})
    return np.array(mi.render(scene, spp=spp, seed=seed))  # type: ignore[arg-type]


def rgb(*values: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(values)}


def square(to_world: Any, **others: Any) -> dict[str, Any]:
    return {"type": "rectangle", "to_world": to_world, **others}


def facing_camera(z: float, **others: Any) -> dict[str, Any]:
    """A wall that fills the view."""
    return square(T4().translate([0, 0, z]).rotate([0, 1, 0], 180).scale(20), **others)


def coarse(image: np.ndarray, factor: int) -> np.ndarray:
    """Means over blocks of pixels."""
    h, w, c = image.shape
    return image.reshape(h // factor, factor, w // factor, factor, c).mean((1, 3))


def camera_rays(camera=CAMERA, within=(0.5, 0.5)) -> np.ndarray:
    """[H, W, 3] directions through pixels."""
    y, x = np.mgrid[0:camera.height, 0:camera.width] + np.reshape(within, (2, 1, 1))
    d = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], -1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def alpha_on(splats: Any, k: int, o: np.ndarray, d: np.ndarray, maxt: Any = np.inf) -> np.ndarray:
    """[...] largest alpha of one round primitive on rays, 0 where it is met beyond them."""
    away = splats.means[k] - o
    t = (away * d).sum(-1)
    distance2 = ((away - t[..., None] * d) ** 2).sum(-1)
    opacity, scale = 1 / (1 + np.exp(-splats.logit_opacities[k])), np.exp(splats.log_scales[k, 0])
    alpha = np.minimum(opacity * np.exp(-0.5 * distance2 / scale**2), 0.99)
    for row in np.flatnonzero(splats.dog_index == k):
        factor = 1 / (1 + np.exp(-splats.dog_logit_opacities[row]))
        scaled = scale * np.exp(splats.dog_log_scales[row, 0])
        alpha = alpha - np.minimum(opacity * factor * np.exp(-0.5 * distance2 / scaled**2), 0.99)
    return np.where((t > 0) & (t < maxt) & (np.abs(alpha) >= 1 / 255), alpha, 0)


def opposite(z: float, x=0.0, scale=0.3, opacity=0.8, color=(0.9, 0.5, 0.2), **dog) -> Any:
    """One round splat at (x, 0, z)."""
    return make_splats([[x, 0.0, z]], scale, opacity, [color], **dog)


# Brute force

@pytest.mark.parametrize("dog", [{}, {"dog": [0], "f_a": 0.7, "F": 1.5}], ids=["gaussian", "dog"])
def test_a_splat_casts_the_shadow_of_a_point_light(dog):
    light, wall_z, intensity, albedo = np.array([3.0, 0.0, 1.0]), 4.0, 9.0, 0.5
    splats = opposite(2.0, x=2.0, color=(0, 0, 0), **dog)  # on the way from the light to the wall, beside the view
    image = render(splats, {
        "wall": facing_camera(wall_z, bsdf={"type": "diffuse", "reflectance": rgb(albedo, albedo, albedo)}),
        "light": {"type": "point", "position": list(light), "intensity": rgb(intensity, intensity, intensity)},
    }, srgb_primitives=False, max_depth=2)
    d = camera_rays()
    hit = d * (wall_z / d[..., 2:])
    to_light = light - hit
    r = np.linalg.norm(to_light, axis=-1)
    w = to_light / r[..., None]
    T = 1 - alpha_on(splats, 0, hit, w, r)
    expected = albedo / np.pi * intensity / r**2 * -w[..., 2] * T
    assert T[:, :9].min() < 0.8
    clear = slice(0, 9)  # the camera sees nothing of the splat in these columns
    np.testing.assert_allclose(image[:, clear], np.repeat(expected[:, clear, None], 3, -1), rtol=2e-3)


@pytest.mark.parametrize("dog_share", [0, 1], ids=["gaussians", "dogs"])
def test_a_point_light_in_a_cloud_is_hidden_by_splats_whose_place_is_before_it(dog_share):
    """Behind the camera, which sees the wall alone. Mitsuba ends shadow rays a little before the light."""
    light, wall_z, intensity, albedo = np.array([0.1, 0.0, -1.5]), 4.0, 9.0, 0.5
    rng = np.random.default_rng(1)
    splats = random_splats(9, seed=1, dog_share=dog_share)
    splats.means, splats.log_scales = light + rng.normal(0, 0.35, (9, 3)), np.log(rng.uniform(0.15, 0.6, (9, 3)))
    splats.sh_coeffs = make_splats(splats.means, colors=0.0).sh_coeffs  # they send no light
    splats = rounded(splats)
    image = render(splats, {
        "wall": facing_camera(wall_z, bsdf={"type": "diffuse", "reflectance": rgb(albedo, albedo, albedo)}),
        "light": {"type": "point", "position": list(light), "intensity": rgb(intensity, intensity, intensity)},
    }, srgb_primitives=False, max_depth=2)
    d = camera_rays().reshape(-1, 3)
    hit = d * (wall_z / d[:, 2:])
    r = np.linalg.norm(light - hit, axis=-1)
    w = (light - hit) / r[:, None]
    ends = r * (1 - mi.math.ShadowEpsilon)
    before, to_light, beyond = (twin.meet(splats, hit, w, maxt) for maxt in (ends, r, np.inf))
    sure = np.all((abs(beyond.places - ends[:, None]) > 1e-4) | (beyond.alphas == 0), axis=1)
    assert sure.mean() > 0.9 and (to_light.alphas != before.alphas)[sure].any()
    T = image[..., 0].ravel() / (albedo / np.pi * intensity / r**2 * -w[:, 2])
    np.testing.assert_allclose(T[sure], twin.transmittance(before)[sure], atol=2e-4)


def test_a_shadow_ray_ends_at_the_light_and_a_wall_hides_splats_behind_it():
    splats = make_splats([[3.0, 0.0, -1.0], [0.0, 0.0, 6.0]], 0.5, 0.9, [[0, 0, 0]] * 2)  # beyond light and wall
    light = {"type": "point", "position": [3.0, 0.0, 1.0], "intensity": rgb(9, 9, 9)}
    others = {"wall": facing_camera(4.0), "light": light}
    with_splats, without = (render(s, others, max_depth=3) for s in (splats, Splats.empty(1)))
    np.testing.assert_allclose(with_splats, without, atol=1e-6)
    assert without.min() > 0.01


@pytest.mark.parametrize("linear", [True, False], ids=["linear", "sRGB"])
@pytest.mark.parametrize("dog", [{}, {"dog": [0], "f_a": 0.5, "F": 1.5}], ids=["gaussian", "dog"])
def test_a_plane_mirror_shows_a_splat_behind_the_camera(linear, dog):
    splats = opposite(-2.0, **dog)
    sky = np.array([0.2, 0.5, 0.9])
    image = render(splats, {"mirror": facing_camera(3.0, bsdf={"type": "conductor"}),
                            "sky": {"type": "constant", "radiance": rgb(*sky)}}, srgb_primitives=not linear)
    d = camera_rays()
    hit, reflected = d * (3.0 / d[..., 2:]), d * (1, 1, -1)
    alpha = alpha_on(splats, 0, hit, reflected)[..., None]
    color = np.array([0.9, 0.5, 0.2])
    expected = alpha * (color if linear else to_linear(color)) + (1 - alpha) * sky
    assert alpha.max() > 0.1
    np.testing.assert_allclose(image, expected, atol=2e-3)


def test_a_glass_slab_bends_what_is_seen_through_it():
    eta, thickness, camera = 1.5, 1.0, Camera(np.eye(4), 6.0, 6.0, 3.0, 2.0, 6, 4)
    splats = opposite(4.0, x=1.2, scale=0.4)
    glass = {"type": "dielectric", "int_ior": eta, "ext_ior": 1.0}
    slab = {"type": "cube", "to_world": T4().translate([0, 0, 2.0]).scale([30, 30, thickness / 2]), "bsdf": glass}
    image = coarse(render(splats, {"slab": slab}, spp=4, srgb_primitives=False, max_depth=3, camera=fine(camera, 8)), 8)
    places = [((i + 0.5) / 8, (j + 0.5) / 8) for i in range(8) for j in range(8)]
    bent, straight = [], []
    for d in (camera_rays(camera, within) for within in places):
        inside = d / eta
        inside[..., 2] = np.sqrt(1 - (inside[..., :2] ** 2).sum(-1))
        leaves = d * (1.5 / d[..., 2:]) + inside * (thickness / inside[..., 2:])
        cos_i, cos_t = d[..., 2], inside[..., 2]
        s, p = (cos_i - eta * cos_t) / (cos_i + eta * cos_t), (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
        through = (1 - (s**2 + p**2) / 2) ** 2
        bent.append(through * alpha_on(splats, 0, leaves, d))
        straight.append(through * alpha_on(splats, 0, np.zeros(3), d))
    expected, unbent = (np.mean(v, 0)[..., None] * (0.9, 0.5, 0.2) for v in (bent, straight))
    assert np.abs(expected - unbent).max() > 0.08  # it does bend
    np.testing.assert_allclose(image, expected, atol=0.03)


@pytest.mark.parametrize("light", [{"type": "constant"}, {"type": "directional", "direction": [0, 0, 1]}])
def test_what_lights_from_infinity_is_hidden_by_splats_however_far_from_the_surfaces(light):
    wall = square(T4().translate([0, 0, 1]).rotate([0, 1, 0], 180).scale(0.1))
    curtain = make_splats([[x, y, -20.0] for x in (-4, 0, 4) for y in (-4, 0, 4)], 6.0, 0.99, [[0, 0, 0]] * 9)
    camera = Camera(np.eye(4), 800.0, 800.0, 8.0, 8.0, 16, 16)
    others = {"wall": wall, "light": light}
    image, lit = (render(s, others, camera=camera, max_depth=2, spp=16) for s in (curtain, Splats.empty(1)))
    beyond = {"ball": {"type": "sphere", "center": [0, 0, 60], "radius": 0.01}}  # the surfaces reach farther, unseen
    wide = render(curtain, others | beyond, camera=camera, max_depth=2, spp=16)
    assert wide.mean() < 0.7 * lit.mean()
    np.testing.assert_allclose(image.mean(), wide.mean(), rtol=0.02)


def test_a_splat_colours_a_wall_and_darkens_the_light_of_the_sky():
    """The radiance of a diffuse wall by quadrature over the hemisphere of one point."""
    splats = opposite(2.0, x=1.5, scale=0.5, opacity=0.9, color=(0.9, 0.1, 0.1))
    camera = Camera(np.eye(4), 8000.0, 8000.0, 40.0, 40.0, 80, 80)
    image = render(splats, {"wall": facing_camera(3.0, bsdf={"type": "diffuse", "reflectance": rgb(.8, .8, .8)}),
                            "sky": {"type": "constant"}}, spp=2, camera=camera, max_depth=2, srgb_primitives=False)
    u, v = (np.mgrid[0:400, 0:400] + 0.5) / 400
    r, phi = np.sqrt(u), 2 * np.pi * v
    w = np.stack([r * np.cos(phi), r * np.sin(phi), -np.sqrt(1 - u)], -1)  # by the cosine
    alpha = alpha_on(splats, 0, np.array([0, 0, 3.0]), w)[..., None]
    expected = 0.8 * (alpha * (0.9, 0.1, 0.1) + (1 - alpha)).mean((0, 1))
    assert expected[1] < 0.77
    np.testing.assert_allclose(image.mean((0, 1)), expected, rtol=0.01)


@pytest.mark.parametrize("z", [3.2, 3.7], ids=["away from the wall", "touching it"])
def test_a_captured_lamp_lights_a_wall_by_its_radiance(z):
    """A small bright model of linear colours: the wall's radiance by quadrature over a screen in front of the lamp."""
    lamp = opposite(z, x=1.0, scale=0.15, opacity=0.95, color=(40.0, 25.0, 12.0))  # out of view
    camera = Camera(np.eye(4), 8000.0, 8000.0, 100.0, 100.0, 200, 200)  # sees one point
    image = render(lamp, {"wall": facing_camera(4.0, bsdf={"type": "diffuse", "reflectance": rgb(.5, .5, .5)})},
                   spp=2, camera=camera, max_depth=3, srgb_primitives=False)
    point, n = np.array([0, 0, 4.0]), 400
    axis = (lamp.means[0] - point) / np.linalg.norm(lamp.means[0] - point)
    side = np.cross(axis, [0, 1, 0])
    side /= np.linalg.norm(side)
    u, v = ((np.mgrid[0:n, 0:n].reshape(2, -1, 1) + 0.5) / n - 0.5) * 2.4
    d = axis + u * side + v * np.cross(axis, side)
    r = np.linalg.norm(d, axis=-1)
    w, solid_angle = d / r[:, None], (2.4 / n) ** 2 / r**3
    alpha = alpha_on(lamp, 0, point, w) * np.maximum(-w[:, 2], 0)
    expected = 0.5 / np.pi * (alpha * solid_angle).sum() * np.array([40.0, 25.0, 12.0])
    assert expected[0] > 0.03
    np.testing.assert_allclose(image.mean((0, 1)), expected, rtol=0.01)


# Energy, and sampling

@pytest.mark.parametrize("material, dog_share", [("diffuse", 0.5), ("conductor", 0.0)])
def test_in_a_white_furnace_nothing_gains_or_loses_energy(material, dog_share):
    splats = random_splats(12, seed=3, degree=0, dog_share=dog_share)
    splats.sh_coeffs[:] = 0.5 / 0.28209479177387814  # white
    bsdf = {"type": "diffuse", "reflectance": rgb(1, 1, 1)} if material == "diffuse" else {"type": "conductor"}
    ball = {"type": "sphere", "center": [0, 0, 3.0], "radius": 0.8, "bsdf": bsdf}
    image = render(splats, {"ball": ball, "sky": {"type": "constant"}}, spp=4, max_depth=-1,
                   camera=fine(CAMERA, 8))
    np.testing.assert_allclose(image.mean(), 1, atol=4e-3)
    assert np.abs(coarse(image, 8) - 1).max() < 0.1


def weights(emission: float, sampled: float) -> Callable:
    """In place of ``mis_weight``: it is asked for emission first, then for a sampled emitter, in turns."""
    calls = [0]

    def weight(of_this, of_other):
        calls[0] += 1
        return dr.select(of_other == 0, mi.Float(1), emission) if calls[0] % 2 else mi.Float(sampled)

    return weight


def test_both_samplings_and_their_combination_agree(monkeypatch):
    splats = make_splats([[0.6, 0.3, 2.2], [-0.5, -0.2, 2.4]], 0.35, 0.8, [[0.5, 0.3, 0.1], [0.1, 0.4, 0.6]])
    lamp = square(T4().translate([0, 0, -1]).scale(1.5), emitter={"type": "area", "radiance": rgb(5, 5, 5)})
    wall = facing_camera(3.5, bsdf={"type": "roughconductor", "alpha": 0.4})
    scene = {"wall": wall, "lamp": lamp}
    how = {"max_depth": 2, "camera": fine(CAMERA, 10)}
    combined = coarse(render(splats, scene, spp=4, **how), 10)
    for one in (weights(1, 0), weights(0, 1)):
        monkeypatch.setattr(light_paths, "mis_weight", one)
        alone = coarse(render(splats, scene, spp=6, seed=1, **how), 10)
        np.testing.assert_allclose(alone.mean((0, 1)), combined.mean((0, 1)), rtol=0.02)
        assert np.abs(alone - combined).mean() < 0.12 * combined.mean()


@pytest.mark.parametrize("max_depth", [1, 4])
def test_without_splats_it_is_the_path_tracer_of_mitsuba(max_depth):
    room = {
        "floor": facing_camera(4.0, bsdf={"type": "diffuse", "reflectance": rgb(.6, .4, .3)}),
        "glass": {"type": "sphere", "center": [-0.6, 0, 3], "radius": 0.5, "bsdf": {"type": "dielectric"}},
        "plastic": {"type": "sphere", "center": [0.6, 0, 3], "radius": 0.5, "bsdf": {"type": "roughplastic"}},
        "lamp": square(T4().translate([0, 2.5, 2]).rotate([1, 0, 0], 90), emitter={"type": "area"}),
        "sky": {"type": "constant", "radiance": rgb(0.1, 0.2, 0.4)},
    }
    nested, view = {"type": "path", "max_depth": max_depth}, fine(CAMERA, 8)
    got = coarse(render(Splats.empty(1), room, spp=4, max_depth=max_depth, camera=view), 8)
    expected = coarse(render(Splats.empty(1), room, type="dogsplat", nested=nested, spp=8, camera=view), 8)
    np.testing.assert_allclose(got.mean((0, 1)), expected.mean((0, 1)), rtol=0.03)
    assert np.abs(got - expected).mean() <= 0.1 * expected.mean()


def test_russian_roulette_changes_no_mean():
    between = [facing_camera(4.0), square(T4().translate([0, 0, -0.5]).scale(20))]
    room = {"front": between[0], "back": between[1], "sky": {"type": "constant"}}
    splats = opposite(2.0, color=(0.9, 0.9, 0.9))
    often, never = (render(splats, room, spp=4, max_depth=5, rr_depth=k, camera=fine(CAMERA, 8)) for k in (1, 100))
    np.testing.assert_allclose(often.mean(), never.mean(), rtol=0.03)
    assert np.abs(often - never).max() > 1e-3  # it does draw


# What it keeps

@pytest.mark.parametrize("spp", [1, 3])
def test_without_other_shapes_it_has_the_bits_of_dogsplat(spp):
    splats = random_splats(30, degree=2)
    sky = {"sky": {"type": "constant", "radiance": rgb(0.3, 0.6, 0.9)}}
    film, aovs = {"pixel_format": "rgba"}, "depth,normal"
    ours, theirs = (render(splats, sky, spp=spp, film=film, aovs=aovs, type=kind) for kind in ("dogpath", "dogsplat"))
    np.testing.assert_array_equal(ours, theirs)


def test_a_tracer_is_not_kept_for_a_new_variable_in_the_place_of_one_that_is_gone():
    scene: Any = scene_of(rounded(random_splats(20, seed=1)), CAMERA, type="dogpath")
    params: Any = mi.traverse(scene)
    directions: Any = camera_rays().reshape(-1, 3).T
    latest, ray = LatestTracer(), mi.Ray3f(mi.Point3f(0), mi.Vector3f(directions))
    name, (shape,) = "splats.logit_opacities", scene.shapes()

    def transmittance(tracer: LatestTracer) -> np.ndarray:
        return np.array(tracer.of(shape.parameters, TraceOptions(sh_degree=3), False)[0].transmittance(ray))

    params[name] = dr.opaque(mi.TensorXf, 4, (20,))
    params.update()
    index, opaque = params[name].array.index, transmittance(latest)
    params[name] = dr.zeros(mi.TensorXf, (20,))
    params.update()
    params[name] = mi.TensorXf(variable_in_the_place_of(index, -3, 20))
    params.update()
    np.testing.assert_array_equal(transmittance(latest), transmittance(LatestTracer()))
    assert transmittance(latest).mean() > opaque.mean() + 0.1


def test_a_moved_shape_and_two_shapes_are_mirrored_where_they_are():
    splats = random_splats(8, seed=5, degree=1, dog_share=0.5)
    splats.means[:, 2] *= -1
    mirror = {"mirror": facing_camera(3.0, bsdf={"type": "conductor"}), "sky": {"type": "constant"}}
    whole = render(splats, mirror)
    parts = [rounded(splats).select(np.arange(k, k + 4)) for k in (0, 4)]
    two = render(parts[0], {**mirror, "more": dog_dict(parts[1])})
    np.testing.assert_allclose(two, whole, atol=1e-5)
    away = rounded(splats)
    away.means[:] -= np.asarray([0.25, 0.5, -1], np.float32)
    scene: Any = scene_of(away, CAMERA, extra=mirror, type="dogpath")
    params: Any = mi.traverse(scene)
    params["splats.to_world"] = mi.Transform4f(T4().translate([0.25, 0.5, -1]))
    params.update()
    np.testing.assert_allclose(np.array(mi.render(scene, spp=1)), whole, atol=1e-4)
    assert np.abs(whole - render(away, mirror)).max() > 0.1


def test_hidden_emitters_light_surfaces_and_alpha_is_of_what_is_left():
    lamp = square(T4().translate([0, 0, 2.0]).rotate([0, 1, 0], 180).scale(0.3),
                  emitter={"type": "area", "radiance": rgb(7, 7, 7)})
    ball = {"type": "sphere", "center": [0.0, 0.0, 4.0], "radius": 1.0}
    others = {"lamp": lamp, "ball": ball, "sky": {"type": "constant"}}
    film = {"pixel_format": "rgba"}
    shown, hidden = (render(Splats.empty(1), others, film=film, hide_emitters=hide) for hide in (False, True))
    assert shown[5, 6, 0] == pytest.approx(7) and shown[0, 0, 0] == pytest.approx(1)
    assert hidden[5, 6, 0] < 2 and hidden[5, 6, 0] > 0 and hidden[5, 6, 3] == 1
    np.testing.assert_array_equal(hidden[0, 0], 0)


@pytest.mark.parametrize("lamp", [None, 1.0, 6.0])
def test_what_is_beyond_the_far_clip_of_the_sensor_is_not_seen_behind_hidden_lamps_either(lamp):
    others: dict[str, Any] = {"wall": facing_camera(8.0), "sky": {"type": "constant", "radiance": rgb(0.1, 0.2, 0.7)}}
    if lamp:
        others["lamp"] = facing_camera(lamp, emitter={"type": "area"})
    for far_clip, seen in ((5.0, False), (20.0, True)):
        sensor = sensor_dict(CAMERA) | {"far_clip": far_clip}
        integrator = {"type": "dogpath", "hide_emitters": bool(lamp), "aovs": "depth"}
        scene: Any = mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor,
                                   "splats": dog_dict(Splats.empty(1)), **others})
        image = np.array(mi.render(scene, spp=1))[2:8, 3:9]
        np.testing.assert_allclose(image[..., 3], 8 if seen else 0, rtol=1e-4)
        if not seen:
            background = np.zeros(3) if lamp else np.array([0.1, 0.2, 0.7])
            np.testing.assert_allclose(image[..., :3] - background, 0, atol=1e-6)


def test_splats_end_at_a_lamp_only_while_it_shows():
    lamp = square(T4().translate([0, 0, 2.0]).rotate([0, 1, 0], 180).scale(5), emitter={"type": "area"})
    behind = opposite(3.0)
    film = {"pixel_format": "rgba"}
    linear = {"film": film, "srgb_primitives": False}
    shown, hidden = (render(behind, {"lamp": lamp}, hide_emitters=hide, **linear) for hide in (False, True))
    np.testing.assert_allclose(shown, 1, atol=1e-6)
    alone = render(behind, {}, **linear)
    np.testing.assert_allclose(hidden, alone, atol=1e-5)


def test_wrong_parameters_are_refused():
    for name, value in (("max_depth", -2), ("rr_depth", 0), ("near_clip", -1.0)):
        with pytest.raises(RuntimeError, match=f'"{name}" '):
            mi.load_dict({**ALONE, name: value})
    with pytest.raises(RuntimeError, match='dogpath: "mesh_shadows" is \'no\', it must be true or false'):
        mi.load_dict({**ALONE, "mesh_shadows": "no"})
    with pytest.raises(RuntimeError, match='"max_depth" is 2.5, it must be an integer'):
        mi.load_dict({**ALONE, "max_depth": 2.5})
    with pytest.raises(RuntimeError, match="nests no integrator"):
        mi.load_dict({**ALONE, "nested": {"type": "path"}})


@pytest.mark.parametrize(("where", "warned"), [("around the sensor", 1), ("in a ball", 1), ("nowhere", 0)])
def test_media_are_not_seen_and_that_is_said_once(capfd, where, warned):
    fog = {"type": "homogeneous", "sigma_t": 1.0}
    ball = {"type": "sphere", "center": [0, 0, 3], "bsdf": {"type": "null"}}
    sensor = sensor_dict(CAMERA) | ({"medium": fog} if where == "around the sensor" else {})
    ball |= {"interior": fog} if where == "in a ball" else {}
    scene = mi.load_dict({"type": "scene", "integrator": ALONE, "sensor": sensor, "ball": ball,
                          "splats": dog_dict(rounded(opposite(2.0)))})
    for _ in range(2):
        mi.render(scene, spp=1)
    told = "".join(capfd.readouterr())
    assert told.count("dogpath: light passes through fog and other media as through empty space") == warned
