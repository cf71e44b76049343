"""Weights of primitives over views against brute force: every primitive at every pixel, in float64."""

import drjit as dr
import numpy as np
import pytest
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.scene.splats import Splats
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


def assert_brute_force(splats: Splats, antialiased=False, masks=(None, None)) -> np.ndarray:
    """Compares all weights where ``masks`` are not black, and returns [N] who dominates a pixel."""
    rng = np.random.default_rng(0)
    planes = [rng.uniform(size=(camera.height, camera.width)) for camera in CAMERAS]
    got = weights(upload(splats), on_device(), options(splats, antialiased=antialiased), planes, masks.__getitem__)
    views, dominates = [], np.zeros(splats.n_splats, bool)
    for camera, plane, mask in zip(CAMERAS, planes, masks, strict=True):
        counts = plane >= 0 if mask is None else mask > 0
        w, T = (of_pixels[:, counts] for of_pixels in reference_score.weights(splats, camera, antialiased=antialiased))
        views.append((w, T, plane[counts]))
        dominates[w.argmax(0)[w.max(0) > 0]] = True
    for found, expected in (
        (got.total, sum(w.sum(1) for w, _, _ in views)),
        (got.transmittance, sum(T.sum(1) for _, T, _ in views)),
        (got.largest, np.max([w.max(1).clip(0) for w, _, _ in views], 0)),
        (got.weighted, sum((e * w).sum(1) for w, _, e in views)),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(got.pixels, sum((T > 0).sum(1) for _, T, _ in views), atol=2)
    np.testing.assert_array_equal(got.dominates, dominates)
    return dominates


@pytest.mark.parametrize(
    ("dog_share", "cut_shares"),
    [(0, (0, 0)), (0.5, (0, 0)), (0, (0.6, 0)), (0.5, (0.6, 0)), (0.5, (0.6, 0.6))],
    ids=["plain", "DoG", "cuts", "DoG, cuts", "DoG, two planes"],
)
@pytest.mark.parametrize("antialiased", [False, True])
def test_sums_largest_and_dominance_equal_brute_force(dog_share, cut_shares, antialiased):
    splats = rounded(random_splats(60, 4, 1, dog_share, 0, *cut_shares))
    assert 5 < assert_brute_force(splats, antialiased).sum() < 60


def test_pixels_that_masks_leave_out_count_for_nothing():
    mask = (np.random.default_rng(1).uniform(size=(33, 20)) > 0.7).astype(np.float32)
    assert_brute_force(rounded(random_splats(60, 4, 1, 0.5)), masks=(None, mask))


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
