"""What bands contribute, against brute force: pictures with coefficients changed, least squares over their pixels."""

from types import SimpleNamespace
from typing import Any

import drjit as dr
import numpy as np
import pytest
from cameras_around import cameras_around
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.scene.sh_basis import SH_SIZES
from mi_dogsplat.scores import bands as module
from mi_dogsplat.scores.bands import bands
from mi_dogsplat.scores.training_views import TrainingViews
from splat_scenes import attached, kernels, options, random_splats, rounded, select

N = 8
CAMERAS = cameras_around(0.9, 6, 24, 18, 20.0)  # so that some bands can be told from others


def scene(degree: int, dog_share=0.3):
    splats = random_splats(N, seed=2, degree=degree, dog_share=dog_share)
    splats.sh_coeffs[:, 0] = np.abs(splats.sh_coeffs[:, 0]) + 2.5  # no colour is below 0, whatever a band does
    splats.logit_opacities[:] = -0.5  # no walk ends early
    splats.log_scales[:] = np.maximum(splats.log_scales, -2)
    return rounded(splats)


def pictures(splats, sh_coeffs) -> np.ndarray:
    """[V, H, W, 3] in float64."""
    raw = {name: np.asarray(getattr(splats, name), np.float64) for name in vars(splats)}
    model: Any = SimpleNamespace(**raw | {"sh_coeffs": sh_coeffs, "dog_index": splats.dog_index})
    return np.stack([reference.render(model, camera)[0] for camera in CAMERAS])


def jacobian(splats, i: int) -> np.ndarray:
    """[V H W, K] of a channel of the pictures by the coefficients of primitive i."""
    x = splats.sh_coeffs.astype(np.float64)
    before, columns = pictures(splats, x)[..., 0], []
    for k in range(x.shape[1]):
        changed = x.copy()
        changed[i, k, 0] += 0.1
        columns.append((pictures(splats, changed)[..., 0] - before).ravel() / 0.1)
    return np.stack(columns, 1)


def best(A: np.ndarray, target: np.ndarray, ridge: float) -> np.ndarray:
    """u with the least |A u + target|² + ridge |u|²."""
    k = A.shape[1]
    return np.linalg.lstsq(np.vstack([A, np.sqrt(ridge) * np.eye(k)]), -np.concatenate([target, np.zeros(k)]))[0]


def expected(A: np.ndarray, sh_coeffs: np.ndarray, degree: int) -> tuple[float, np.ndarray]:
    """(loss, coefficients [K, 3]) without the bands above ``degree``; ``A`` is the ``jacobian`` of the primitive."""
    x, size = sh_coeffs.astype(np.float64), SH_SIZES[degree]
    ridge = module.RIDGE * (A[:, 0] ** 2).sum()
    loss, fitted = 0.0, np.zeros_like(x)
    for c in range(3):
        dropped = -A[:, size:] @ x[size:, c]
        u = best(A[:, :size], dropped, ridge)
        loss += np.square(dropped + A[:, :size] @ u).sum()
        fitted[:size, c] = x[:size, c] + u
    return loss, fitted


def found(splats):
    on_device = [DeviceCamera.upload(camera) for camera in CAMERAS]
    return bands(upload(splats), splats.sh_coeffs, TrainingViews(on_device, options(splats)))


@pytest.mark.parametrize("degree", [1, 3])
def test_losses_are_those_of_pictures_without_the_bands_and_the_others_fitted(degree):
    splats = scene(degree)
    got = found(splats)
    losses = got.losses()
    assert losses.shape == (N, degree + 1) and losses.dtype == np.float64
    by_primitive = [(jacobian(splats, i), splats.sh_coeffs[i]) for i in range(N)]
    brute = [[expected(A, sh_coeffs, d) for d in range(degree + 1)] for A, sh_coeffs in by_primitive]
    wanted = np.array([[loss for loss, _ in of_degrees] for of_degrees in brute])
    scale = np.abs(wanted).max()
    np.testing.assert_allclose(losses, wanted, rtol=2e-3, atol=1e-4 * scale)
    assert (np.abs(wanted[:, 0]) > 0.01 * scale).sum() >= N // 2  # there is something to lose
    degrees = np.arange(N) % (degree + 1)
    fitted = got.fitted(degrees)
    assert fitted.dtype == splats.sh_coeffs.dtype
    for i, d in enumerate(degrees):
        np.testing.assert_allclose(fitted[i, SH_SIZES[d] :], 0)
        if d < degree:
            np.testing.assert_allclose(fitted[i], brute[i][d][1], atol=0.02)
        else:
            np.testing.assert_array_equal(fitted[i], splats.sh_coeffs[i])


def test_losses_fall_with_the_degree_and_refitting_never_loses_more():
    splats = scene(3)
    losses = found(splats).losses()
    assert (np.diff(losses, axis=1) <= 1e-6 * losses.max()).all() and not losses[:, -1].any()
    for i in range(N):
        dropped = splats.sh_coeffs.astype(np.float64)
        dropped[i, 1:] = 0
        plain = np.square(pictures(splats, dropped) - pictures(splats, splats.sh_coeffs * 1.0)).sum()
        assert losses[i, 0] <= 1.001 * plain


def test_a_model_without_bands_loses_nothing_and_one_without_primitives_is_no_error():
    assert not found(scene(0)).losses().any()
    nothing = scene(1).select(np.zeros(N, bool))
    assert found(nothing).losses().shape == (0, 2)


def test_what_no_view_shows_loses_nothing_and_parameters_are_left_alone():
    splats = scene(2)
    splats.means[0], splats.means[1] = [0, 0, -9], np.nan
    params = attached(splats)
    views = TrainingViews([DeviceCamera.upload(c) for c in CAMERAS[2:3]], options(splats))
    got = bands(params, splats.sh_coeffs, views).losses()
    assert not got[:2].any() and got[2:, 0].any() and np.isfinite(got).all()
    assert dr.grad_enabled(params["means"]) and not dr.grad(params["means"]).numpy().any()


def test_rows_are_taken_in_parts_that_change_nothing(monkeypatch):
    splats = scene(2)
    whole = found(splats)
    losses, fitted = whole.losses(), whole.fitted(np.arange(N) % 3)
    monkeypatch.setattr(module, "ROWS", 3)
    np.testing.assert_allclose(whole.losses(), losses, rtol=1e-12)
    np.testing.assert_allclose(whole.fitted(np.arange(N) % 3), fitted, rtol=1e-6)


def test_no_kernel_is_compiled_whatever_the_number_of_primitives():
    model = random_splats(200, seed=1, degree=1, dog_share=0)
    views = TrainingViews([DeviceCamera.upload(CAMERAS[0])], RasterOptions(sh_degree=1))

    def once(n: int):
        splats = select(model, n)
        bands(upload(splats), splats.sh_coeffs, views)

    known = kernels(lambda: [once(n) for n in (100, 101)])
    for n in (137, 50, 12, 200):
        assert not kernels(lambda n=n: once(n)) - known
