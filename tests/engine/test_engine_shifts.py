"""Places that depend on the view: the engine against the float64 twin."""

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.arrays import backward
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import SMOOTH
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.project import project
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.engine.walks.composite import composite
from mi_dogsplat.reference.gradients import gradients_tiled, render_tiled
from mi_dogsplat.scene.splats import Splats
from read_together import read_gradients
from same_numbers import assert_same_numbers
from shifted_models import places_seen, with_shifts
from splat_scenes import (
    assert_gradients_equal,
    attached,
    image_of,
    kernels,
    make_camera,
    options,
    random_splats,
    rasterized,
    rounded,
    tilted_camera,
)

CAMERA = tilted_camera(40, 30, f=36.0)
WITH_ALL = {"slope_share": 0.5, "cut_share": 0.5, "second_cut_share": 0.5, "curvature_share": 0.5}


def model(n=30, seed=2, degree=2, **others: Any) -> Splats:
    return rounded(random_splats(n, seed, degree, shift_share=0.6, **others))


def gradients(splats: Splats, adjoint: np.ndarray, camera=CAMERA, **others) -> dict[str, np.ndarray]:
    params = attached(splats)
    frame = rasterize(params, DeviceCamera.upload(camera), options(splats, **others))
    planes = [mi.Float(plane.ravel().astype(np.float32)) for plane in np.moveaxis(adjoint, -1, 0)]
    backward(frame.colors, planes)
    names = [name for name, value in params.items() if dr.grad_enabled(value)]
    return {name: values.reshape(getattr(splats, name).shape) for name, values in read_gradients(params, names).items()}


@pytest.mark.parametrize("others", [{}, WITH_ALL], ids=["alone", "with all else"])
def test_the_image_is_that_of_the_twin(others):
    splats = model(**others)
    image = image_of(rasterized(splats, CAMERA), CAMERA)
    expected = render_tiled(splats, CAMERA).image
    assert np.abs(expected - render_tiled(splats.without_shifts(), CAMERA).image).max() > 0.1
    off = np.abs(image - expected).max(axis=2)
    assert np.median(off) < 1e-6 and np.quantile(off, 0.99) < 1e-3  # a cutoff may fall on the other side
    smooth = image_of(rasterized(splats, CAMERA, cutoffs=SMOOTH), CAMERA)
    twin = render_tiled(splats, CAMERA, min_alpha=0.0, min_transmittance=0.0).image
    np.testing.assert_allclose(smooth, twin, atol=5e-6)


@pytest.mark.parametrize("others", [{}, WITH_ALL], ids=["alone", "with all else"])
def test_gradients_are_those_of_the_twin(others):
    splats, adjoint = model(**others), np.random.default_rng(0).normal(size=(30, 40, 3))
    found = gradients(splats, adjoint, cutoffs=SMOOTH)
    expected = gradients_tiled(splats, CAMERA, adjoint, min_alpha=0.0, min_transmittance=0.0)
    assert {"view_shifts", "mean_views"} <= set(found)
    assert_gradients_equal(found, expected)


def test_a_mixed_model_has_the_colours_along_the_views_to_where_it_is_stored():
    splats = model(degree=3)
    mixed = splats.with_sh_degrees(np.arange(splats.n_splats) % 4)
    padded = mixed.uniform_sh()
    found, expected = (image_of(rasterized(s, CAMERA), CAMERA) for s in (mixed, padded))
    np.testing.assert_allclose(found, expected, atol=2e-6)
    np.testing.assert_allclose(found, render_tiled(mixed, CAMERA).image, atol=2e-3)


def test_along_parallel_rays_all_are_seen_along_the_axis():
    splats = with_shifts(random_splats(12, seed=4, degree=0))
    camera = DeviceCamera.upload(CAMERA, perspective=False)
    projection = project(upload(splats), camera, sh_degree=0)
    axis = CAMERA.w2c[2, :3]
    places = places_seen(splats, axis[None])[:, 0] @ CAMERA.w2c[:3, :3].T + CAMERA.w2c[:3, 3]
    for found, place, f, c in ((projection.x, places[:, 0], CAMERA.fx, CAMERA.cx),
                               (projection.y, places[:, 1], CAMERA.fy, CAMERA.cy),
                               (projection.depth, places[:, 2], 1, 0)):  # fmt: skip
        np.testing.assert_allclose(found.numpy()[splats.shift_index], f * place + c, rtol=1e-5, atol=1e-4)


def test_what_cannot_be_drawn_is_not_and_harms_nobody():
    splats = model(n=8, degree=0)
    splats = replace(splats, shift_index=np.arange(4), view_shifts=np.zeros((4, 3, 3)), mean_views=np.zeros((4, 3)))
    splats.view_shifts[0], splats.view_shifts[1, 1, 1], splats.mean_views[2, 0] = np.inf, np.nan, np.inf
    splats.view_shifts[3] = 1e30
    found = project(upload(splats), DeviceCamera.upload(CAMERA), sh_degree=0).visible.numpy()
    assert not found[:3].any() and found[4:].any()  # the fourth is drawn, so far away that no pixel shows it
    got = gradients(splats, np.ones((30, 40, 3)))
    assert all(np.isfinite(values).all() for values in got.values())
    assert all(not values[:4].any() for name, values in got.items() if len(values) == 8)


def test_one_that_is_stored_on_the_camera_centre_is_where_no_view_has_moved_it():
    """It has no direction, which counts as zero, in the engine as in the twin."""
    camera = make_camera(40, 30, 36.0)
    splats = with_shifts(random_splats(4, seed=4, degree=1), every=1)
    splats.means[2], splats.view_shifts[2] = 0, 30 * splats.view_shifts[2]
    if reference.project(splats, camera).depths[2] <= 0:
        splats.mean_views[2] *= -1
    expected = reference.project(splats, camera)
    found = project(upload(splats), DeviceCamera.upload(camera), sh_degree=1)
    assert expected.visible[2] and found.visible.numpy()[2]
    np.testing.assert_allclose(found.depth.numpy(), expected.depths, rtol=1e-5)
    adjoint = np.ones((30, 40, 3))
    got = gradients(splats, adjoint, camera, cutoffs=SMOOTH)
    twin = gradients_tiled(splats, camera, adjoint, min_alpha=0.0, min_transmittance=0.0)
    assert all(np.isfinite(values).all() for values in got.values())
    assert_gradients_equal({"view_shifts": got["view_shifts"]}, {"view_shifts": twin["view_shifts"]})


def test_a_row_of_zeros_changes_no_bit_and_no_other_primitive():
    """An infinite scale times no move is no number; such a primitive is drawn as wide as a float allows."""
    splats = rounded(random_splats(12, seed=5, degree=1))
    splats.log_scales[3] = 60.0
    still = image_of(rasterized(splats, CAMERA), CAMERA)
    given = replace(splats, shift_index=[7], view_shifts=np.zeros((1, 3, 3)), mean_views=np.ones((1, 3)) / 2)
    assert_same_numbers(image_of(rasterized(given, CAMERA), CAMERA), still)
    splats.log_scales[3] = 200.0
    assert project(upload(splats), DeviceCamera.upload(CAMERA), sh_degree=1).visible.numpy()[3]
    given = replace(splats, shift_index=[7], view_shifts=np.zeros((1, 3, 3)), mean_views=np.ones((1, 3)) / 2)
    assert project(upload(given), DeviceCamera.upload(CAMERA), sh_degree=1).visible.numpy()[3]


def test_compositing_has_the_same_kernels_as_without_them():
    """They cost something where a primitive is projected, and nothing where a pixel is drawn."""
    splats = model(degree=1)

    def composited(splats: Splats) -> set[str]:
        frame = rasterized(splats, CAMERA)
        dr.eval(frame.projection, frame.colors, frame.T)
        view: Any = frame.view
        return kernels(lambda: dr.eval(composite(view).features))

    composited(splats)
    assert composited(splats) == composited(splats.without_shifts())


def test_the_twin_and_the_engine_agree_on_who_is_in_front():
    splats = model(n=60, seed=9, degree=0)
    depths = project(upload(splats), DeviceCamera.upload(CAMERA), sh_degree=0).depth.numpy()
    expected = reference.project(splats, CAMERA)
    np.testing.assert_allclose(depths[expected.visible], expected.depths[expected.visible], rtol=2e-6, atol=2e-6)
