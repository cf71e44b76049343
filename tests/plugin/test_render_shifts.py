"""What integrators make of primitives whose place depends on the view: where cameras move, lamps and mirrors."""

from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import Splats
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.options import RasterOptions
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.plugin import splat_integrator
from mi_dogsplat.plugin.splat_lamps import lamps_of
from mi_dogsplat.scene.mitsuba_cameras import opencv_w2c_to_mitsuba_c2w
from own_axes_models import CAMERA, SHIFTED
from shifted_models import places_seen, standing, with_shifts
from splat_scenes import (
    dog_dict,
    make_splats,
    rasterized,
    rounded,
    scene_of,
    sensor_dict,
)

from benchmarks.numerics.moved_cameras import device_motion, posed


@pytest.mark.parametrize("aovs", ["", "depth"])
def test_derivatives_by_the_pose_of_the_sensor_equal_differences(monkeypatch, aovs):
    """A camera that moves sees primitives elsewhere; without cutoffs no alpha appears at once.

    A depth is divided by alpha, and so it counts where that is neither small nor of a pseudo-Gaussian.
    """
    monkeypatch.setattr(splat_integrator, "RasterOptions", partial(RasterOptions, cutoffs=SMOOTH))
    model = SHIFTED.model.plain() if aovs else SHIFTED.model
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
