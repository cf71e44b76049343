"""Derivatives by the pose of a camera through a nudge, against differences of the float64 renderer."""

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera, Nudge
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.scene.camera_motions import motion_gradient, moved_w2c
from mi_dogsplat.scene.splats import Splats
from same_numbers import assert_same_numbers
from splat_scenes import SMOOTH_OPTIONS, options, random_splats, rounded, tilted_camera

CAMERA = tilted_camera(16, 12, f=14.0, cx=7.0, cy=6.5)
ADJOINT = np.random.default_rng(0).normal(size=(12, 16, 3))
EXTENT = 2.5


def by_nudge(splats: Splats, **choices) -> tuple[np.ndarray, list[np.ndarray]]:
    """(gradient by a motion of the camera [6], planes of the picture)"""
    nudge = Nudge.of(splats.n_splats)
    camera = replace(DeviceCamera.upload(CAMERA), nudge=nudge)
    frame = rasterize(upload(splats), camera, options(splats, **choices))
    for c, plane in enumerate(frame.colors):
        dr.set_grad(plane, mi.Float(np.ascontiguousarray(ADJOINT[..., c].astype(np.float32).ravel())))
    dr.enqueue(dr.ADMode.Backward, frame.colors)
    dr.traverse(dr.ADMode.Backward)
    by_pose = np.array([[dr.sum(dr.grad(value))[0] for value in nudge.values]])
    gradient = motion_gradient(CAMERA.w2c[None], np.zeros((1, 6)), EXTENT, by_pose)[0]
    return gradient, [plane.numpy() for plane in frame.colors]


def by_differences(splats: Splats, step: float = 1e-6, **choices) -> np.ndarray:
    def loss(motion: np.ndarray) -> float:
        camera = replace(CAMERA, w2c=moved_w2c(CAMERA.w2c[None], motion[None], EXTENT)[0])
        return float((ADJOINT * reference.render(splats, camera, smooth=True, **choices)[0]).sum())

    return np.array([(loss(step * e) - loss(-step * e)) / (2 * step) for e in np.eye(6)])


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("mixed", [False, True], ids=["one degree", "degrees of their own"])
def test_the_derivative_by_each_of_six_numbers_is_that_of_the_twin(mixed, antialiased):
    splats = rounded(random_splats(30, degree=2, dog_share=0.5))
    splats = splats.with_sh_degrees(np.arange(30) % 3) if mixed else splats
    got, _ = by_nudge(splats, antialiased=antialiased, **SMOOTH_OPTIONS)
    expected = by_differences(splats, antialiased=antialiased)
    assert np.abs(expected).min() > 0.1
    np.testing.assert_allclose(got, expected, rtol=1e-3)


def test_a_nudge_changes_no_bit_of_the_picture():
    splats = rounded(random_splats(30, degree=2))
    plain = rasterize(upload(splats), DeviceCamera.upload(CAMERA), options(splats)).colors
    for got, expected in zip(by_nudge(splats)[1], plain, strict=True):
        assert_same_numbers(got, expected.numpy())
