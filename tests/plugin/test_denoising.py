"""The AOV ``denoising``: what of a picture has noise, and what a denoiser looks for edges in."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from dogpath_scenes import rgb
from mi_dogsplat.plugin.denoising import CHANNELS
from mi_dogsplat.scene.cameras import Camera
from splat_scenes import dog_dict, make_splats, rounded, sensor_dict

CAMERA = Camera(np.eye(4), 18.0, 18.0, 6.0, 5.0, 12, 10)  # at the origin, looks along z
T4 = mi.ScalarTransform4f
GRAY = (0.3, 0.5, 0.2)


def scene_of(others: dict[str, Any], splats: Any = None, aovs="denoising", **integrator) -> mi.Scene:
    splats = make_splats([[0, 0, -5.0]]) if splats is None else splats  # behind the camera
    integrator = {"type": "dogpath", "aovs": aovs, **integrator}
    sensor = sensor_dict(CAMERA, rfilter={"type": "box"})
    scene = mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor,
                          "splats": dog_dict(rounded(splats)), **others})  # fmt: skip
    assert isinstance(scene, mi.Scene)
    return scene


def planes(scene: mi.Scene, spp=1, seed=0) -> dict[str, np.ndarray]:
    """Colours, and the channels of the AOV: paths, albedo, normal."""
    render: Any = mi.render
    image = np.array(render(scene, spp=spp, seed=seed))
    integrator: Any = scene.integrator()
    names = integrator.aov_names()
    assert tuple(names) == CHANNELS
    colors, *rest = np.split(image, [3, 6, 9], -1)
    return {"colors": colors} | dict(zip(("paths", "albedo", "normal"), rest, strict=True))


def wall(z: float, bsdf: dict[str, Any]) -> dict[str, Any]:
    to_world = T4().translate([0, 0, z]).rotate([0, 1, 0], 180).scale(20)
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf}


DIFFUSE = {"type": "diffuse", "reflectance": rgb(*GRAY)}
SKY = {"type": "constant", "radiance": 0.7}


def test_without_splats_in_front_all_is_of_paths():
    found = planes(scene_of({"wall": wall(4, DIFFUSE), "sky": SKY}), spp=4)
    np.testing.assert_allclose(found["paths"], found["colors"], atol=1e-6)
    np.testing.assert_allclose(found["albedo"], np.broadcast_to(GRAY, (10, 12, 3)), atol=1e-6)
    np.testing.assert_allclose(found["normal"], np.broadcast_to([0, 0, -1], (10, 12, 3)), atol=1e-6)


@pytest.mark.parametrize("seed", [0, 1])
def test_what_is_not_of_paths_has_no_noise(seed):
    """Colours less paths are what splats show before a black wall, whatever lights it and whatever the seed."""
    splats = make_splats([[-0.4, 0, 2], [0.5, 0.1, 3]], 0.4, [0.8, 0.99], [[0.9, 0.5, 0.2], [0.1, 0.4, 0.8]])
    black = wall(4, {"type": "diffuse", "reflectance": 0.0})
    alone = np.array(mi.render(scene_of({"wall": black}, splats, aovs=""), spp=4))
    lamp = {"type": "point", "position": [1, 1, 0], "intensity": 3.0}
    found = planes(scene_of({"wall": wall(4, DIFFUSE), "lamp": lamp, "sky": SKY}, splats), spp=4, seed=seed)
    same_places = seed == 0  # other seeds look at other places in the pixels
    np.testing.assert_allclose(found["colors"] - found["paths"], alone, atol=1e-5 if same_places else 0.05)
    assert found["paths"].max() > 0.1 and alone.max() > 0.1


def test_guides_are_seen_through_splats():
    splats = make_splats([[0, 0, 2]], 50.0, 0.75, 0.5)  # a haze that lets a quarter through
    found = planes(scene_of({"wall": wall(4, DIFFUSE), "sky": SKY}, splats))
    np.testing.assert_allclose(found["albedo"], np.broadcast_to(np.multiply(0.25, GRAY), (10, 12, 3)), atol=2e-3)
    np.testing.assert_allclose(found["normal"], np.broadcast_to([0, 0, -0.25], (10, 12, 3)), atol=2e-3)


def test_a_mirror_has_the_guides_of_what_it_shows():
    mirror, behind = wall(4, {"type": "conductor"}), wall(-3, {"type": "twosided", "bsdf": DIFFUSE})
    found = planes(scene_of({"mirror": mirror, "behind": behind, "sky": SKY}))
    np.testing.assert_allclose(found["albedo"], np.broadcast_to(GRAY, (10, 12, 3)), atol=1e-5)
    np.testing.assert_allclose(found["normal"], np.broadcast_to([0, 0, 1], (10, 12, 3)), atol=1e-5)


def test_splats_in_a_mirror_count_as_albedo():
    splats = make_splats([[0, 0, -3]], 6.0, 1 - 1e-6, [[0.9, 0.5, 0.2]])  # behind the camera, and opaque
    scene = scene_of({"mirror": wall(4, {"type": "conductor"})}, splats, srgb_primitives=False)
    found = planes(scene)
    np.testing.assert_allclose(found["albedo"], found["paths"], atol=1e-5)
    assert abs(found["albedo"][5, 6] - [0.9, 0.5, 0.2]).max() < 0.02


def test_emitters_count_as_albedo_up_to_white():
    found = planes(scene_of({"sky": {"type": "constant", "radiance": rgb(0.2, 0.6, 3.0)}}))
    assert (found["albedo"] == 0).all()  # nothing is path traced where there is no surface: there is no noise either
    assert (found["paths"] == 0).all() and np.allclose(found["colors"], [0.2, 0.6, 3.0])
    small = {"type": "sphere", "center": [0, 0, 4], "radius": 0.1, "bsdf": DIFFUSE}
    found = planes(scene_of({"sky": {"type": "constant", "radiance": rgb(0.2, 0.6, 3.0)}, "ball": small}))
    np.testing.assert_allclose(found["albedo"][0], np.broadcast_to([0.2, 0.6, 1], (12, 3)), atol=1e-6)
    assert (found["normal"][0] == 0).all()


def test_what_light_passes_straight_has_the_guides_of_what_is_behind():
    pane = wall(2, {"type": "mask", "opacity": 0.0, "nested": {"type": "diffuse", "reflectance": 0.9}})
    found = planes(scene_of({"pane": pane, "wall": wall(4, DIFFUSE), "sky": SKY}))
    np.testing.assert_allclose(found["albedo"], np.broadcast_to(GRAY, (10, 12, 3)), atol=1e-5)


@pytest.mark.slow
def test_colours_and_derivatives_are_those_without_it():
    splats = make_splats([[-0.4, 0, 2], [0.5, 0.1, 3]], 0.4, [0.8, 0.99], [[0.9, 0.5, 0.2], [0.1, 0.4, 0.8]])
    images, gradients = [], []
    for aovs in ("", "denoising"):
        scene = scene_of({"wall": wall(4, DIFFUSE), "sky": SKY}, splats, aovs=aovs)
        images.append(np.array(mi.render(scene, spp=4))[..., :3])
        params: Any = mi.traverse(scene)
        integrator: Any = scene.integrator()
        dr.enable_grad(params["splats.sh_coeffs"])
        params.update()
        adjoint = np.ones((10, 12, 3 + len(integrator.aov_names())), np.float32)
        integrator.render_backward(scene, params, mi.TensorXf(adjoint), spp=4)
        gradients.append(dr.grad(params["splats.sh_coeffs"]).numpy())
    np.testing.assert_allclose(*images, atol=1e-6)
    np.testing.assert_allclose(*gradients, rtol=1e-4, atol=1e-6)
    assert np.abs(gradients[0]).max() > 0.1


def test_only_dogpath_has_it():
    with pytest.raises(RuntimeError, match='dogsplat: unknown AOV "denoising"; available are alpha'):
        mi.load_dict({"type": "dogsplat", "aovs": "denoising"})
