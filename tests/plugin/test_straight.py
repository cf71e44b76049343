"""``dogpath`` among surfaces that light passes straight: shadow rays go on behind them, and nothing counts twice."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from dogpath_scenes import rgb
from launches import KernelWatch
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.plugin import direct_light, light_paths
from mi_dogsplat.plugin.shadow_ratios import estimated
from mi_dogsplat.plugin.straight import LatestStraight, lets_straight
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from splat_scenes import dog_dict, fine, make_splats, rounded, sensor_dict

T4 = mi.ScalarTransform4f
CAMERA = Camera(np.eye(4), 36.0, 36.0, 12.0, 10.0, 24, 20)  # at the origin, looks along z
SEED: Any = 1
NOTHING = rounded(Splats.empty(1))
TINT = [0.9, 0.3, 0.6]
ALBEDO, INTENSITY, LIGHT, WALL = 0.5, 9.0, np.array([0.0, 0.0, -1.0]), 4.0


def diffuse(*reflectance: float) -> dict[str, Any]:
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(*reflectance)}}


def mask(opacity: Any, bsdf: Any = None) -> dict[str, Any]:
    return {"type": "mask", "opacity": opacity, "bsdf": bsdf or diffuse(0, 0, 0)}


GLASS = {"type": "thindielectric", "int_ior": 1.0, "ext_ior": 1.0, "specular_transmittance": rgb(*TINT)}
PASSED = {
    "mask": ([mask(0.4)], [0.6, 0.6, 0.6]),
    "tinted": ([GLASS], TINT),
    "blend": ([{"type": "blendbsdf", "weight": 0.3, "a": GLASS, "b": diffuse(0, 0, 0)}], 0.7 * np.array(TINT)),
    "two": ([mask(0.4), GLASS], 0.6 * np.array(TINT)),
    "opaque behind": ([mask(0.4), diffuse(0, 0, 0)], [0, 0, 0]),
    "empty": ([{"type": "null"}], [1, 1, 1]),
}  # fmt: skip


def square(z: float, size: float, bsdf: Any) -> dict[str, Any]:
    return {"type": "rectangle", "to_world": T4().translate([0, 0, z]).rotate([0, 1, 0], 180).scale(size), "bsdf": bsdf}


def scene_of(others: dict[str, Any], splats: Any = NOTHING, camera=CAMERA, **integrator) -> Any:
    """Linear colours, unless it is told otherwise."""
    integrator = {"type": "dogpath", "srgb_primitives": False, **integrator}
    return mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor_dict(camera),
                         "splats": dog_dict(splats), **others})


def render(scene: Any, spp=1, seed: Any = 0) -> np.ndarray:
    return np.array(mi.render(scene, spp=spp, seed=seed), float)


def lit_wall(panes: list, size=20.0, at=-0.5) -> dict[str, Any]:
    """A wall, a point of light behind the camera, and panes between the two, which the camera does not see."""
    named = {f"pane_{k}": square(at + 0.1 * k, size, pane) for k, pane in enumerate(panes)}
    light = {"type": "point", "position": list(LIGHT), "intensity": rgb(*[INTENSITY] * 3)}
    return {"wall": square(WALL, 20, diffuse(*[ALBEDO] * 3)), "light": light, **named}


def expected_wall() -> np.ndarray:
    """[20, 24] radiance without panes."""
    y, x = np.mgrid[0:20, 0:24] + 0.5
    hit = np.stack([(x - 12) / 36, (y - 10) / 36, np.ones_like(x)], -1) * WALL
    to_light = LIGHT - hit
    distance = np.linalg.norm(to_light, axis=-1)
    return ALBEDO / np.pi * INTENSITY / distance**2 * -to_light[..., 2] / distance


@pytest.mark.parametrize("name", PASSED)
def test_the_shade_of_a_pane_is_what_it_keeps(name):
    panes, passed = PASSED[name]
    image = render(scene_of(lit_wall(panes), max_depth=2))
    np.testing.assert_allclose(image, expected_wall()[..., None] * np.array(passed), rtol=2e-3, atol=1e-7)


def test_splats_weaken_what_panes_let_pass():
    splats = rounded(make_splats([[0.0, 0, -0.7]], 4.0, 0.5, [[0, 0, 0]]))  # behind the camera, between light and pane
    clear, dim = (render(scene_of(lit_wall([mask(0.4)]), model, max_depth=2)) for model in (NOTHING, splats))
    np.testing.assert_allclose(dim, 0.5 * clear, rtol=0.01)


def test_surfaces_that_are_passed_do_not_count_in_the_length_of_a_path():
    """Six before the camera, and six before the light."""
    before = {f"before_{k}": square(0.5 + 0.1 * k, 20, {"type": "null"}) for k in range(6)}
    image = render(scene_of({**lit_wall([{"type": "null"}] * 6, at=-0.9), **before}, max_depth=2))
    np.testing.assert_allclose(image, np.repeat(expected_wall()[..., None], 3, -1), rtol=2e-3)


ROOM = {
    "floor": square(4.0, 20, diffuse(0.6, 0.4, 0.3)),
    "ball": {"type": "sphere", "center": [-0.6, 0, 3], "radius": 0.5, "bsdf": mask(0.4, diffuse(0.8, 0.3, 0.2))},
    "leaf": {"type": "rectangle", "to_world": T4().translate([0, 1, 2]).rotate([1, 0, 0], 70),
             "bsdf": mask({"type": "checkerboard", "to_uv": mi.ScalarTransform4f().scale(7)}, diffuse(0.3, 0.7, 0.2))},
    "pane": {"type": "rectangle", "to_world": T4().translate([0.5, 0.2, 2.5]).rotate([1, 1, 0], 30).scale(0.4),
             "bsdf": {"type": "blendbsdf", "weight": 0.3, "a": GLASS, "b": diffuse(0.2, 0.3, 0.9)}},
    "lamp": {"type": "rectangle", "to_world": T4().translate([0, 2.5, 2]).rotate([1, 0, 0], 90).scale(0.3),
             "emitter": {"type": "area", "radiance": rgb(60, 50, 40)}, "bsdf": {"type": "null"}},
    "sky": {"type": "constant", "radiance": rgb(0.1, 0.2, 0.4)},
}  # fmt: skip


@pytest.mark.parametrize("max_depth", [2, 8])
def test_it_is_the_path_tracer_of_mitsuba_whose_shadow_rays_pass_as_well(max_depth):
    """``volpath``, which counts path lengths in the same way."""
    ours = render(scene_of(ROOM, camera=fine(CAMERA, 6), max_depth=max_depth), spp=6)
    nested = {"type": "volpath", "max_depth": max_depth}
    theirs = render(scene_of(ROOM, camera=fine(CAMERA, 6), type="dogsplat", nested=nested), spp=24)
    blocks = [image.reshape(10, 12, 12, 12, 3).mean((1, 3)) for image in (ours, theirs)]
    np.testing.assert_allclose(ours.mean((0, 1)), theirs.mean((0, 1)), rtol=0.01)
    assert np.abs(blocks[0] - blocks[1]).mean() < 0.05 * theirs.mean()


def test_either_sampling_alone_finds_the_same_light(monkeypatch):
    """Behind masks, and behind several."""
    lamp = {"type": "rectangle", "to_world": T4().translate([0, 0, -1]).scale(1.5),
            "emitter": {"type": "area", "radiance": rgb(5, 5, 5)}}
    others = {"wall": square(3.5, 20, diffuse(0.5, 0.5, 0.5)), "lamp": lamp, "sky": {"type": "constant"},
              "near": square(-0.4, 9, mask(0.3)), "far": square(-0.6, 9, mask(0.5))}
    how = {"max_depth": 2, "camera": fine(CAMERA, 8), "hide_emitters": True}
    means = [render(scene_of(others, **how), spp=2).mean()]
    for kept in (light_paths, direct_light):
        for module in (light_paths, direct_light):
            monkeypatch.setattr(module, "mis_weight", lambda of_this, of_other, weight=float(module is kept): dr.select(
                of_other == 0, 1, mi.Float(weight)))
        means.append(render(scene_of(others, **how), spp=4, seed=1).mean())
    assert means[0] > 0.05
    assert means == pytest.approx([means[0]] * 3, rel=0.02)


def test_opacity_has_derivatives_where_the_camera_and_where_shadow_rays_pass():
    """Light and camera look through one pane of opacity a: the picture is (1 - a)^2 times that without."""
    at, wall = 0.4, lit_wall([])
    scene = scene_of({**wall, "pane": square(1.0, 20, mask(at))}, camera=fine(CAMERA, 4), max_depth=2)
    params: Any = mi.traverse(scene)
    opacity = "pane.bsdf.opacity.value"
    full = render(scene_of(wall, max_depth=2)).mean()
    assert render(scene, spp=4).mean() == pytest.approx((1 - at) ** 2 * full, rel=0.02)

    dr.enable_grad(params[opacity])
    params.update()
    mean = dr.mean(mi.render(scene, params, spp=4, seed=SEED), axis=None)
    dr.backward(mean)
    assert np.sum(dr.grad(params[opacity])) == pytest.approx(-2 * (1 - at) * full, rel=0.02)
    dr.set_grad(params[opacity], 1)
    along = dr.forward_to(dr.mean(mi.render(scene, params, spp=4, seed=SEED), axis=None))
    assert along.numpy().item() == pytest.approx(-2 * (1 - at) * full, rel=0.02)


def test_opacity_has_derivatives_where_nothing_lies_before_the_light():
    """The camera sees a grey pane of opacity a, and nothing behind it: the picture is a times that of a wall."""
    at = 0.4
    pane = square(WALL, 20, mask(at, diffuse(*[ALBEDO] * 3)))
    scene = scene_of(lit_wall([]) | {"wall": pane}, max_depth=2)
    params: Any = mi.traverse(scene)
    opacity, full = "wall.bsdf.opacity.value", expected_wall().mean()
    assert render(scene).mean() == pytest.approx(at * full, rel=2e-3)

    dr.enable_grad(params[opacity])
    params.update()
    scene.integrator().render_backward(scene, params, mi.TensorXf(np.full((20, 24, 3), 1 / 1440, np.float32)))
    assert np.sum(dr.grad(params[opacity])) == pytest.approx(full, rel=2e-3)
    dr.set_grad(params[opacity], 1)
    params.update()
    assert np.mean(scene.integrator().render_forward(scene, params)) == pytest.approx(full, rel=2e-3)


@pytest.mark.parametrize("max_depth", [2, 3])
def test_what_passes_is_left_to_splats_in_the_shade(max_depth):
    """``mesh_shadows``: a black pane of opacity 0.4 before all of the sky on one side."""
    scene: Any = mi.load_dict({"type": "scene", "pane": square(0.3, 500, mask(0.4)), "sky": {"type": "constant"}})
    ratios = estimated(scene, upload(rounded(make_splats([[0, 0, 0]], [0.3, 0.3, 0.01]))), max_depth, 256)
    up, down = (ratios.front, ratios.back) if ratios.axis[2][0] > 0 else (ratios.back, ratios.front)
    np.testing.assert_allclose(np.array(up)[:, 0], 0.6, atol=0.005)
    np.testing.assert_array_equal(np.array(down)[:, 0], 1)


def test_scenes_are_told_apart_and_instances_are_looked_into():
    known, ball = LatestStraight(), {"type": "sphere", "bsdf": mask(0.5)}
    opaque = mi.load_dict({"type": "scene", "wall": square(3, 1, diffuse(1, 1, 1))})
    instanced = mi.load_dict({"type": "scene", "group": {"type": "shapegroup", "ball": ball},
                              "instance": {"type": "instance", "group": {"type": "ref", "id": "group"}}})
    assert not lets_straight(opaque) and lets_straight(instanced)
    assert [known.of(scene) for scene in (opaque, instanced, instanced, opaque)] == [False, True, True, False]


def test_a_shape_that_is_given_a_mask_lets_light_pass_from_then_on():
    scene = scene_of(lit_wall([diffuse(0, 0, 0)]), max_depth=2)
    assert render(scene).max() == 0
    pane: Any = next(shape for shape in scene.shapes() if shape.id() == "pane_0")
    pane.set_bsdf(mi.load_dict(mask(0.4)))
    np.testing.assert_allclose(render(scene), 0.6 * expected_wall()[..., None].repeat(3, -1), rtol=2e-3)


def test_a_mask_is_noticed_that_a_shape_of_a_group_is_given():
    known, ball = LatestStraight(), {"type": "sphere", "bsdf": diffuse(1, 1, 1)}
    scene = mi.load_dict({"type": "scene", "group": {"type": "shapegroup", "ball": ball},
                          "instance": {"type": "instance", "group": {"type": "ref", "id": "group"}}})
    parts: Any = mi.traverse(scene).hierarchy
    assert not known.of(scene)
    next(part for part in parts if part.class_name() == "Sphere").set_bsdf(mi.load_dict(mask(0.5)))
    assert known.of(scene)


def test_no_kernel_is_compiled_for_a_number_of_lanes_or_a_segment():
    """Widths of its segments are random numbers."""
    scene = scene_of(ROOM, camera=fine(CAMERA, 2), max_depth=6)
    with KernelWatch() as kernels:
        for seed in range(3):
            if seed == 2:
                kernels.forget()
            render(scene, seed=seed)
    assert kernels.launched > 10
    assert not kernels.new
