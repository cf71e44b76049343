"""Weights of primitives over views against brute force: every primitive at every pixel, in float64."""

import drjit as dr
import numpy as np
import pytest
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.scores.slope_losses import slope_losses
from mi_dogsplat.scores.training_views import TrainingViews
from mi_dogsplat.scores.weights import weights
from splat_scenes import (
    attached,
    kernels,
    make_camera,
    make_splats,
    options,
    random_splats,
    rounded,
    select,
    tilted_camera,
)

CAMERAS = [tilted_camera(45, 37), make_camera(20, 33, f=25.0)]


def on_device(cameras=CAMERAS):
    return [DeviceCamera.upload(camera) for camera in cameras]


@pytest.mark.parametrize(
    ("dog_share", "cut_shares"),
    [(0, (0, 0)), (0.5, (0, 0)), (0, (0.6, 0)), (0.5, (0.6, 0)), (0.5, (0.6, 0.6))],
    ids=["plain", "DoG", "cuts", "DoG, cuts", "DoG, two planes"],
)
@pytest.mark.parametrize("antialiased", [False, True])
def test_sums_largest_and_dominance_equal_brute_force(dog_share, cut_shares, antialiased):
    splats = rounded(random_splats(60, 4, 1, dog_share, 0, *cut_shares))
    planes = [np.random.default_rng(0).uniform(size=(camera.height, camera.width)) for camera in CAMERAS]
    got = weights(upload(splats), on_device(), options(splats, antialiased=antialiased), planes)
    views = [reference_score.weights(splats, camera, antialiased=antialiased) for camera in CAMERAS]

    def assert_close(a, b):
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-5)

    assert_close(got.total, sum(w.sum((1, 2)) for w, _ in views))
    assert_close(got.transmittance, sum(T.sum((1, 2)) for _, T in views))
    np.testing.assert_allclose(got.pixels, sum((T > 0).sum((1, 2)) for _, T in views), atol=2)
    assert_close(got.largest, np.max([w.max((1, 2)).clip(0) for w, _ in views], 0))
    assert_close(got.weighted, sum((e * w).sum((1, 2)) for e, (w, _) in zip(planes, views, strict=True)))
    dominates = np.zeros(60, bool)
    for w, _ in views:
        dominates[w.argmax(0)[w.max(0) > 0]] = True
    assert 5 < dominates.sum() < 60
    np.testing.assert_array_equal(got.dominates, dominates)


def test_pixels_that_masks_leave_out_count_for_nothing():
    splats = rounded(random_splats(60, 4, 1, 0.5))
    rng = np.random.default_rng(1)
    masks = [None, (rng.uniform(size=(33, 20)) > 0.7).astype(np.float32)]
    planes = [rng.uniform(size=(camera.height, camera.width)) for camera in CAMERAS]
    got = weights(upload(splats), on_device(), options(splats), planes, masks.__getitem__)
    views = [reference_score.weights(splats, camera) for camera in CAMERAS]
    (w, T, e), (v, U, f) = ((*view, plane) for view, plane in zip(views, planes, strict=True))
    counts = masks[1] > 0
    v, U, f = v[:, counts], U[:, counts], f[counts]  # [N, pixels]

    def assert_close(a, b):
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-5)

    assert_close(got.total, w.sum((1, 2)) + v.sum(1))
    assert_close(got.transmittance, T.sum((1, 2)) + U.sum(1))
    np.testing.assert_allclose(got.pixels, (T > 0).sum((1, 2)) + (U > 0).sum(1), atol=2)
    assert_close(got.largest, np.maximum(w.max((1, 2)), v.max(1)).clip(0))
    assert_close(got.weighted, (e * w).sum((1, 2)) + (f * v).sum(1))
    dominates = np.zeros(60, bool)
    dominates[w.argmax(0)[w.max(0) > 0]] = dominates[v.argmax(0)[v.max(0) > 0]] = True
    np.testing.assert_array_equal(got.dominates, dominates)


def test_what_no_view_shows_weighs_nothing_and_parameters_are_left_alone():
    params = attached(rounded(make_splats([[0, 0, -2], [50, 0, 2], [0, 0, 3]], 0.2, 0.5)))
    got = weights(params, on_device([make_camera()]), RasterOptions(sh_degree=0))
    np.testing.assert_array_equal(got.weighted, got.total)
    for values in (got.total, got.transmittance, got.pixels, got.largest, got.dominates):
        assert values[2] > 0 and not values[:2].any()
    assert dr.grad_enabled(params["means"]) and not dr.grad(params["means"]).numpy().any()


def test_no_kernel_is_compiled_whatever_the_number_of_primitives():
    model, cameras = random_splats(1000, seed=1, dog_share=0), on_device()
    known = kernels(lambda: [weights(upload(select(model, n)), cameras, RasterOptions()) for n in (100, 101)])
    for n in (137, 500, 12, 1000):
        new = kernels(lambda n=n: weights(upload(select(model, n)), cameras, RasterOptions())) - known
        assert not new, f"N = {n}: {len(new)} new kernels"


def test_of_no_primitive_there_are_no_weights_and_no_losses():
    nothing = upload(rounded(random_splats(3, degree=1, slope_share=1.0)).select(np.zeros(3, bool)))
    got = weights(nothing, on_device(), RasterOptions(1))
    assert all(values.shape == (0,) for values in vars(got).values()) and got.dominates.dtype == bool
    assert slope_losses(nothing, TrainingViews(on_device(), RasterOptions(1))).shape == (0,)
