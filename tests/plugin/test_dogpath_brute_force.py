"""``dogpath``: shadows, mirror images and refractions of splats against brute force in float64."""

from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from dogpath_scenes import T4, camera_rays, coarse, facing_camera, opposite, render, rgb, square
from mi_dogsplat.reference import rays as twin
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from splat_scenes import (
    fine,
    make_splats,
    random_splats,
    rounded,
    to_linear,
)


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
