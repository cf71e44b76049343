"""``dogpath``: energy, sampling, and what it keeps."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from dogpath_scenes import ALONE, CAMERA, T4, camera_rays, coarse, facing_camera, opposite, render, rgb, square
from mi_dogsplat.plugin import direct_light, light_paths
from mi_dogsplat.plugin.dogpath import LatestTracer
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
    variable_in_the_place_of,
)

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


def test_both_samplings_and_their_combination_agree(monkeypatch):
    splats = make_splats([[0.6, 0.3, 2.2], [-0.5, -0.2, 2.4]], 0.35, 0.8, [[0.5, 0.3, 0.1], [0.1, 0.4, 0.6]])
    lamp = square(T4().translate([0, 0, -1]).scale(1.5), emitter={"type": "area", "radiance": rgb(5, 5, 5)})
    wall = facing_camera(3.5, bsdf={"type": "roughconductor", "alpha": 0.4})
    scene = {"wall": wall, "lamp": lamp}
    how = {"max_depth": 2, "camera": fine(CAMERA, 10)}
    combined = coarse(render(splats, scene, spp=4, **how), 10)
    for emission, sampled in ((1.0, 0.0), (0.0, 1.0)):
        monkeypatch.setattr(light_paths, "mis_weight", lambda of_this, of_other, weight=emission: dr.select(
            of_other == 0, mi.Float(1), weight))
        monkeypatch.setattr(direct_light, "mis_weight", lambda of_this, of_other, weight=sampled: mi.Float(weight))
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


PLACES_OF_FOG = [("around the sensor", 1), ("in a ball", 1), ("in a group", 1), ("nowhere", 0)]


@pytest.mark.parametrize(("where", "warned"), PLACES_OF_FOG)
def test_media_are_not_seen_and_that_is_said_once(capfd, where, warned):
    fog = {"type": "homogeneous", "sigma_t": 1.0}
    ball = {"type": "sphere", "center": [0, 0, 3], "bsdf": {"type": "null"}}
    sensor = sensor_dict(CAMERA) | ({"medium": fog} if where == "around the sensor" else {})
    ball |= {"interior": fog} if where in ("in a ball", "in a group") else {}
    shown = {"ball": ball}
    if where == "in a group":
        shown = {"group": {"type": "shapegroup", **shown}}
        shown |= {"instance": {"type": "instance", "group": {"type": "ref", "id": "group"}}}
    scene = mi.load_dict({"type": "scene", "integrator": ALONE, "sensor": sensor, **shown,
                          "splats": dog_dict(rounded(opposite(2.0)))})
    for _ in range(2):
        mi.render(scene, spp=1)
    told = "".join(capfd.readouterr())
    assert told.count("dogpath: light passes through fog and other media as through empty space") == warned
