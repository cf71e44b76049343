"""Blending stops at a depth of each pixel: images and derivatives beside the float64 twin."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import Frame, rasterize
from mi_dogsplat.reference.forward import RAW_PARAMETERS
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.scene.splats import Splats
from read_together import read, read_gradients
from splat_scenes import (
    assert_gradients_equal,
    attached,
    differences,
    image_of,
    opaque_only,
    options,
    plane_of,
    random_splats,
    rounded,
    square_camera,
)

CAMERA = square_camera(20, 16, f=18.0)
LEVELS = np.array([0.5, 2.2, 3.0, 4.1, np.inf], np.float32)
WHERE = np.random.default_rng(3).integers(0, len(LEVELS), (16, 20))


def stopped(splats: Splats, **choices) -> list[np.ndarray]:
    """Image, T and depth of the twin where each pixel sees only what is nearer than its level."""
    depth = CAMERA.project(splats.means)[1]
    result = [np.zeros((16, 20, 3)), np.zeros((16, 20)), np.zeros((16, 20))]
    for k, level in enumerate(LEVELS):
        near = Camera(CAMERA.w2c, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 20, 16)
        kept = opaque_only(splats, depth <= level)
        for whole, part in zip(result, reference.render(kept, near, **choices), strict=True):
            whole[WHERE == k] = part[WHERE == k]
    return result


def rasterized(params: dict, splats: Splats, **choices) -> Frame:
    stop = mi.Float(LEVELS[WHERE].ravel())
    return rasterize(params, DeviceCamera.upload(CAMERA), options(splats, **choices), stop_depth=stop)


@pytest.mark.parametrize("dog_share", [0.0, 0.5])
@pytest.mark.parametrize("negative_transmittance", [True, False])
def test_each_pixel_blends_what_is_nearer_than_its_surface(dog_share, negative_transmittance):
    splats = rounded(random_splats(40, seed=2, degree=1, dog_share=dog_share))
    choices = {"negative_transmittance": negative_transmittance}
    frame: Any = rasterized(upload(splats), splats, depth=True, **choices)
    image, T, depth = stopped(splats, **choices)
    for got, expected in ((image_of(frame, CAMERA), image), (plane_of(frame.T, CAMERA), T),
                          (plane_of(frame.depth, CAMERA), depth)):
        assert np.abs(got - expected).mean() < 2e-5
    everything = reference.render(splats, CAMERA, **choices)[0]
    assert np.abs(image - everything).max() > 0.2


@pytest.fixture(scope="module")
def small() -> tuple[Splats, np.ndarray, dict[str, np.ndarray]]:
    splats = rounded(random_splats(6, seed=4, degree=0))
    adjoint = np.random.default_rng(0).normal(size=(16, 20, 4))

    def loss(s: Splats) -> float:
        image, T, _ = stopped(s)
        return float(np.sum(adjoint * np.dstack([image, T])))

    return splats, adjoint, differences(splats, loss, eps=1e-7)


@pytest.mark.slow
def test_backward_mode_stops_at_the_surface(small):
    splats, adjoint, expected = small
    params = attached(splats)
    frame = rasterized(params, splats)
    planes = [*frame.colors, frame.T]
    loss: Any = sum(dr.sum(p * mi.Float(adjoint[..., c].ravel())) for c, p in enumerate(planes))
    dr.backward(loss)
    got = read_gradients(params, RAW_PARAMETERS)
    assert_gradients_equal({name: values.reshape(expected[name].shape) for name, values in got.items()}, expected)


@pytest.mark.parametrize("name", RAW_PARAMETERS)
def test_forward_mode_stops_at_the_surface(small, name):
    splats, adjoint, expected = small
    params = upload(splats)
    direction = np.random.default_rng(1).normal(size=expected[name].shape)
    dr.enable_grad(params[name])
    dr.set_grad(params[name], mi.Float(direction.ravel()))
    frame = rasterized(params, splats)
    planes = [*frame.colors, frame.T]
    dr.forward_to(planes)
    got = sum(np.sum(adjoint[..., c].ravel() * tangent) for c, tangent in enumerate(read(map(dr.grad, planes))))
    terms = expected[name] * direction
    assert abs(got - terms.sum()) < 1e-2 * np.abs(terms).sum()


def test_smooth_cutoffs_stop_at_surfaces_too():
    """Lists that no cutoff shortens: the last pixel of a tile decides when a walk ends."""
    splats = rounded(random_splats(40, seed=2, degree=1, dog_share=0.3))
    frame = rasterized(upload(splats), splats, cutoffs=SMOOTH)
    hidden = WHERE == 0
    assert (plane_of(frame.T, CAMERA)[hidden] == 1).all() and (plane_of(frame.T, CAMERA)[~hidden] < 1).any()
