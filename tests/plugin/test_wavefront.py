"""Passes whose light paths are traced together: what each of them would bring alone, by fewer launches."""

from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from device_peak import device_peak
from dogpath_scenes import CAMERA, T4, facing_camera, rgb, square
from launches import KernelWatch, kernels
from mi_dogsplat.plugin import light_paths, wavefront
from mi_dogsplat.plugin.numbers import Streams
from mi_dogsplat.plugin.samples import samples
from mi_dogsplat.scene.mitsuba_cameras import camera_to_mitsuba
from splat_scenes import random_splats, rounded, scene_of

SEED: Any = 3
SPLATS = rounded(random_splats(12, seed=3, degree=1))
FEW = {"wall": facing_camera(4.5), "sky": {"type": "constant", "radiance": rgb(0.3, 0.4, 0.5)}}
PANE = {"type": "mask", "opacity": 0.4, "nested": {"type": "diffuse"}}
MANY = FEW | {
    "floor": square(T4().translate([0, 1.2, 2]).rotate([1, 0, 0], 90).scale(3), bsdf={"type": "conductor"}),
    "pane": square(T4().translate([0.5, 0, 1.2]).scale(0.6), bsdf=PANE),
    "lamp": square(T4().translate([0, -1, 1]).rotate([1, 0, 0], -90).scale(0.4),
                   emitter={"type": "area", "radiance": rgb(6, 5, 4)}),
}  # fmt: skip


@pytest.fixture
def alone(monkeypatch):
    """Traces each view for itself, after it is called."""
    return lambda: monkeypatch.setattr(wavefront, "RAYS", (1, 1))


def scene_with(others: dict[str, Any], **integrator) -> Any:
    how = {"type": "dogpath", "max_depth": 2} | integrator
    return scene_of(SPLATS, CAMERA, film={"rfilter": {"type": "box"}}, extra=others, **how)


def film_of(width: int, height: int) -> dict[str, Any]:
    return {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgba", "rfilter": {"type": "box"}}


def sensor(aside=0.0, **others) -> dict[str, Any]:
    """That of ``CAMERA``, some way to the right."""
    to_world = T4().translate([aside, 0, 0]) @ camera_to_mitsuba(CAMERA)["to_world"]
    film = film_of(CAMERA.width, CAMERA.height)
    return {"type": "perspective", "fov": 37.0, "to_world": to_world, "film": film, **others}


def lens() -> Any:
    return mi.load_dict(sensor(type="thinlens", aperture_radius=0.2, focus_distance=2.5))


def two_views() -> Any:
    film = film_of(2 * CAMERA.width, CAMERA.height)
    return mi.load_dict({"type": "batch", "film": film, "left": sensor(-0.3), "right": sensor(0.3)})


@pytest.mark.parametrize(
    ("other", "first", "how"),
    [
        (None, None, {"aovs": "denoising,depth"}),
        (lens, 4, {"hide_emitters": True}),
        (two_views, None, {"mesh_shadows": True}),
    ],
    ids=["pinhole", "lens", "batch"],
)
def test_passes_together_have_the_bits_of_passes_alone(alone, other, first, how):
    scene = scene_with(MANY, **how)
    integrator: Any = scene.integrator()
    integrator.see_through, integrator.first_pass = "hide_emitters" in how, first
    of = {"sensor": other()} if other else {}

    def pictures() -> list[np.ndarray]:
        return [np.array(mi.render(scene, **of, spp=spp, seed=SEED)) for spp in (2, 5)]

    together = pictures()
    alone()
    for a, b in zip(together, pictures(), strict=True):
        np.testing.assert_array_equal(a, b)
        assert a.std() > 0.01


@pytest.mark.parametrize("forward", [True, False])
def test_derivatives_of_passes_together_are_those_of_passes_alone(alone, forward):
    def derivative() -> np.ndarray:
        scene = scene_with(FEW)
        params: Any = mi.traverse(scene)
        names = "splats.logit_opacities", "wall.bsdf.reflectance.value"
        if forward:
            x = mi.Float(0)
            dr.enable_grad(x)
            dr.set_grad(x, 1)
            for name in names:
                params[name] = params[name] + x
            params.update()
            return np.array(dr.forward_to(mi.render(scene, params, spp=5, seed=SEED)))
        for name in names:
            dr.enable_grad(params[name])
        params.update()
        image: Any = mi.render(scene, params, spp=5, seed=SEED)
        dr.backward(dr.sum(image * image))
        return np.concatenate([np.array(dr.grad(params[name])).ravel() for name in names])

    together = derivative()
    alone()
    apart = derivative()
    assert np.abs(apart).max() > 1e-3
    np.testing.assert_allclose(together, apart, rtol=1e-4, atol=1e-5 * np.abs(apart).max())


def test_another_number_of_passes_compiles_nothing():
    scene = scene_with(FEW)

    def picture(spp: int) -> None:
        dr.eval(mi.render(scene, spp=spp, seed=SEED))

    with KernelWatch() as of_pictures:
        picture(2)
        picture(3)
        of_pictures.forget()
        picture(7)
    assert of_pictures.launched > 20
    assert of_pictures.new == []


def test_kernels_of_derivatives_do_not_grow_with_the_number_of_passes():
    """But for the sums of the gradients that passes have of the primitives."""
    scene = scene_with(FEW)
    params: Any = mi.traverse(scene)

    def derived(spp: int) -> None:
        dr.enable_grad(params["splats.means"])
        params.update()
        dr.backward(dr.mean(mi.render(scene, params, spp=spp, seed=SEED)))
        dr.eval(dr.grad(params["splats.means"]))

    few, many = ({ops for _, ops in kernels(partial(derived, spp))} for spp in (3, 7))
    assert max(few) > 1000
    assert max(many - few) < 10 * 7


@pytest.mark.parametrize("forward", [True, False])
def test_memory_of_derivatives_does_not_grow_with_the_number_of_passes(forward):
    scene = scene_of(rounded(random_splats(2000, seed=3, degree=1)), CAMERA)
    params: Any = mi.traverse(scene)
    places = params["splats.means"]

    def derived(spp: int) -> None:
        x = mi.Float(0)
        dr.enable_grad(x)
        dr.set_grad(x, 1)
        params["splats.means"] = places + x
        params.update()
        image: Any = mi.render(scene, params, spp=spp, seed=SEED)
        if forward:
            dr.eval(dr.forward_to(image))
        else:
            dr.backward(dr.mean(image))
            dr.eval(dr.grad(x))

    few, many = (device_peak(partial(derived, spp)) for spp in (3, 24))
    assert many < 1.2 * few


def test_paths_of_all_passes_are_traced_once(monkeypatch):
    traced, radiance = [], light_paths.LightPaths.radiance

    def counted(paths: Any, ray: Any, *others: Any) -> Any:
        traced.append(dr.width(ray))
        return radiance(paths, ray, *others)

    monkeypatch.setattr(light_paths.LightPaths, "radiance", counted)
    mi.render(scene_with(FEW), spp=10)
    assert traced == [10 * CAMERA.width * CAMERA.height]


def test_pixels_draw_what_they_draw_alone():
    passes, n = samples(3, seed=5), 70
    together = Streams(passes, n).at(dr.arange(mi.UInt32, 3 * n), 2)
    apart = [Streams([one], n).at(dr.arange(mi.UInt32, n), 2) for one in passes]
    for draw in (lambda numbers: numbers.next_1d().numpy(), lambda numbers: numbers.next_2d().numpy()):
        parts = [draw(numbers) for numbers in apart]
        np.testing.assert_array_equal(draw(together), np.concatenate(parts, axis=-1))
        assert np.abs(np.diff(parts, axis=0)).min() > 0


def test_large_pictures_and_large_models_are_traced_pass_by_pass():
    most = wavefront.RAYS[dr.backend_v(mi.Float) is dr.JitBackend.CUDA]
    assert wavefront.views_at_once(most // 4, 10) == 4
    assert wavefront.views_at_once(most + 1, 10) == wavefront.views_at_once(10, wavefront.PRIMITIVES) == 1
    assert wavefront.views_at_once(10, wavefront.PRIMITIVES // 3) == 3


def test_a_view_of_constant_planes_is_joined_as_wide_as_the_others():
    planes = wavefront.joined([[mi.Float(0)], [mi.Float([1, 2, 3])], [mi.Float(7)]])
    np.testing.assert_array_equal(planes[0].numpy(), [0, 0, 0, 1, 2, 3, 7, 7, 7])


@pytest.mark.parametrize("count", [1, 3])
def test_what_is_joined_is_parted_again(count):
    views = [[mi.Float(np.arange(4) + 10 * k), mi.UInt32(np.arange(4) + k)] for k in range(count)]
    planes = wavefront.joined(views)
    assert [dr.width(plane) for plane in planes] == [4 * count] * 2
    for found, given in zip(wavefront.parted(planes, count), views, strict=True):
        for a, b in zip(found, given, strict=True):
            np.testing.assert_array_equal(a.numpy(), b.numpy())


def test_progress_is_told_after_passes_that_are_traced_together(monkeypatch):
    told: list[tuple[int, int]] = []
    scene = scene_with(FEW)
    integrator: Any = scene.integrator()
    integrator.on_pass = lambda *counts: told.append(counts)
    monkeypatch.setattr(wavefront, "RAYS", (2 * CAMERA.width * CAMERA.height,) * 2)
    mi.render(scene, spp=5)
    assert told == [(2, 5), (4, 5), (5, 5)]
