"""Scores and mechanisms of the rivals against brute force: every primitive at every pixel, in float64."""

from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.compare.methods import METHODS
from mi_dogsplat.compare.rivals import dash, taming
from mi_dogsplat.compare.rivals.gaussian_spa import projected
from mi_dogsplat.compare.rivals.lightgaussian import GlobalSignificance
from mi_dogsplat.compare.rivals.lp_3dgs import masked_logits
from mi_dogsplat.compare.rivals.mask_gaussian import ABSENT, by_share
from mi_dogsplat.compare.rivals.mini_splatting import SummedWeight, sampling_keys
from mi_dogsplat.compare.rivals.pup import Sensitivity, fisher
from mi_dogsplat.compare.rivals.radsplat import LargestWeight
from mi_dogsplat.compare.rivals.taming import parabola
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import rasterize
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.runs.history import run_to_end
from mi_dogsplat.scores.training_views import TrainingViews
from mi_dogsplat.training.train import Trainer
from splat_scenes import SMOOTH_OPTIONS, make_camera, make_splats, options, random_splats, rounded, tilted_camera

CAMERAS = [tilted_camera(45, 37), make_camera(20, 33, f=25.0)]
SPLATS = rounded(random_splats(60, seed=4, degree=1, dog_share=0))
WEIGHTS = [reference_score.weights(SPLATS, camera) for camera in CAMERAS]


def score(rule: Any, splats=SPLATS, cameras=CAMERAS, background=0.0, **others) -> np.ndarray:
    on_device = [DeviceCamera.upload(camera) for camera in cameras]
    return rule(upload(splats), TrainingViews(on_device, options(splats, **others), background), 0)


def test_radsplat_is_the_largest_weight_of_any_ray():
    expected = np.max([weight.max((1, 2)) for weight, _ in WEIGHTS], 0)
    np.testing.assert_allclose(score(LargestWeight()), expected, rtol=1e-3, atol=1e-6)


def test_lightgaussian_is_opacity_times_transmittance_over_its_pixels_times_a_power_of_the_volume():
    opacity = 1 / (1 + np.exp(-SPLATS.logit_opacities.astype(np.float64)))
    volume = np.exp(SPLATS.log_scales.astype(np.float64)).prod(1)
    expected = sum((opacity[:, None, None] * T).sum((1, 2)) for _, T in WEIGHTS) * volume**0.1
    np.testing.assert_allclose(score(GlobalSignificance()), expected, rtol=1e-3)


def test_mini_splatting_is_the_summed_weight_of_those_that_are_the_first_of_some_pixel():
    first = np.zeros(60, bool)
    for weight, _ in WEIGHTS:
        first[weight.argmax(0)[weight.max(0) > 0]] = True
    expected = first * sum(weight.sum((1, 2)) for weight, _ in WEIGHTS)
    assert 0 < np.count_nonzero(expected) < 60
    np.testing.assert_allclose(score(SummedWeight()), expected, rtol=1e-3)


def test_mini_splatting_draws_in_proportion_to_importance_and_never_what_has_none():
    importance, rng, counts = np.array([0.0, 1.0, 2.0, 5.0]), np.random.default_rng(0), np.zeros(4)
    pairs: dict[tuple[int, ...], int] = {}
    for _ in range(4000):
        order = np.argsort(-sampling_keys(importance, rng))
        counts[order[0]] += 1
        pair = tuple(sorted(order[:2].tolist()))
        pairs[pair] = pairs.get(pair, 0) + 1
    np.testing.assert_allclose(counts / 4000, importance / 8, atol=0.025)  # 3 standard deviations
    # of two drawn without replacement: P(1, 2) = 1/8 * 2/7 + 2/8 * 1/6
    assert pairs[1, 2] / 4000 == pytest.approx(1 / 28 + 1 / 24, abs=0.013)
    assert all(0 not in pair for pair in pairs)


def brute_force_fisher(splats, cameras, background: float, eps=1e-5) -> np.ndarray:
    """Central differences of whole pictures by each mean and log scale; sums of patches; products."""
    names = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs", "dog_logit_opacities", "dog_log_scales")
    raw: dict[str, Any] = {name: np.array(getattr(splats, name), np.float64) for name in names}
    raw["dog_index"] = splats.dog_index
    total = np.zeros((splats.n_splats, 6, 6))
    for camera in cameras:
        rows, columns = -(-camera.height // 4), -(-camera.width // 4)

        def patch_sums(rows=rows, columns=columns, camera=camera) -> np.ndarray:
            image = reference.render(SimpleNamespace(**raw), camera, [background] * 3, smooth=True)[0]  # type: ignore
            padded = np.zeros((4 * rows, 4 * columns, 3))
            padded[: camera.height, : camera.width] = image
            return padded.reshape(rows, 4, columns, 4, 3).sum((1, 3)).ravel()

        for i in range(splats.n_splats):
            gradient = []
            for k in range(6):
                array = raw["means" if k < 3 else "log_scales"]
                value = array[i, k % 3]
                array[i, k % 3] = value + eps
                above = patch_sums()
                array[i, k % 3] = value - eps
                gradient.append((above - patch_sums()) / (2 * eps))
                array[i, k % 3] = value
            total[i] += np.array(gradient) @ np.array(gradient).T
    return total


@pytest.mark.parametrize("background", [0.0, 1.0])
def test_pup_is_the_log_determinant_of_squared_derivatives_of_patches(background):
    splats, cameras = (
        rounded(random_splats(8, seed=3, degree=1, dog_share=0)),
        [tilted_camera(22, 17), make_camera(19, 26, f=25.0)],
    )
    splats.logit_opacities[[0, 3]] = 6  # beyond the limit of .99 near the centre
    expected = brute_force_fisher(splats, cameras, background)
    on_device = [DeviceCamera.upload(camera) for camera in cameras]
    got = fisher(upload(splats), TrainingViews(on_device, options(splats, **SMOOTH_OPTIONS), background))
    scale = np.sqrt(np.einsum("nii->ni", expected))
    assert (scale > 1e-3).all(1).sum() >= 6
    error = np.abs(got - expected) / np.maximum(scale[:, :, None] * scale[:, None, :], 1e-6)
    assert error.max() < 2e-3, error.max((1, 2))
    log_det = np.linalg.slogdet(expected)[1]
    scores = score(Sensitivity(), splats, cameras, background, **SMOOTH_OPTIONS)
    least = np.linalg.eigvalsh(expected / (scale[:, :, None] * scale[:, None, :]))[:, 0]
    sound = least > 1e-5  # else float32 cannot tell
    assert sound.sum() >= 3 and np.isfinite(scores).all()
    np.testing.assert_allclose(scores[sound], log_det[sound], atol=0.1)


def test_pup_puts_what_no_view_shows_last():
    splats = rounded(make_splats([[0, 0, -2], [0.2, 0, 2], [50, 0, 2]], 0.2, 0.5))
    got = score(Sensitivity(), splats)
    assert np.isfinite(got[1]) and np.isneginf(got[[0, 2]]).all()


def masked_images(splats, camera, shares: np.ndarray, background: float, smooth: bool = False) -> np.ndarray:
    """C = Σ c m α T + T b, T <- T (1 - m α) for masks [N], [H, W, 3]; walks do not end."""
    projection = reference.project(splats, camera)
    x, y = reference.pixel_centres(0, 0, camera.width, camera.height)
    image, T = np.zeros((len(x), 3)), np.ones(len(x))
    for i in reference.depth_order(projection):
        alpha = np.minimum(0.99, reference.kernels(projection, i, x, y)[0])
        alpha = np.where((alpha < 1 / 255) & (not smooth), 0, alpha) * shares[i]
        image += (alpha * T)[:, None] * projection.colors[i]
        T = T * (1 - alpha)
    return (image + background * T[:, None]).reshape(camera.height, camera.width, 3)


@pytest.mark.parametrize("background", [0.0, 1.0])
def test_maskgaussian_has_the_derivative_of_a_loss_by_every_mask_drawn_or_not(background):
    splats, camera = rounded(random_splats(15, seed=7, degree=0, dog_share=0)), tilted_camera(45, 37)
    rng = np.random.default_rng(2)
    drawn, adjoint = (rng.uniform(size=15) < 0.5) * 1.0, rng.normal(size=(37, 45, 3))
    assert 4 < drawn.sum() < 11
    expected = np.zeros(15)
    for i in range(15):  # affine in each m: the difference of 1 and 0 is the derivative
        with_it, without = (np.where(np.arange(15) == i, value, drawn) for value in (1.0, 0.0))
        difference = masked_images(splats, camera, with_it, background) - masked_images(
            splats, camera, without, background
        )
        expected[i] = np.sum(adjoint * difference)
    params, on_device = upload(splats), DeviceCamera.upload(camera)
    seen = params | {"logit_opacities": dr.select(mi.Float(drawn) > 0, params["logit_opacities"], ABSENT)}
    frame = rasterize(seen, on_device, options(splats))
    image = [dr.detach(plane + background * frame.T, preserve_type=False) for plane in frame.colors]
    np.testing.assert_allclose(
        np.stack([plane.numpy() for plane in image], -1).reshape(37, 45, 3),
        masked_images(splats, camera, drawn, background),
        atol=1e-4,
    )
    Float: Any = dr.detached_t(mi.Float)
    planes = [Float(np.ascontiguousarray(adjoint[..., c].ravel(), np.float32)) for c in range(3)]
    got = by_share(params, on_device, options(splats), Float(drawn), image, planes).numpy()
    assert np.abs(expected[drawn == 0]).max() > 0.1  # those that are not drawn learn as well
    np.testing.assert_allclose(got, expected, rtol=1e-3, atol=1e-3)


def test_lp_3dgs_masks_multiply_opacities_and_so_alphas():
    splats, camera = rounded(random_splats(15, seed=7, degree=0, dog_share=0)), tilted_camera(45, 37)
    splats.logit_opacities[:] = np.minimum(splats.logit_opacities, 3)  # below the limit of .99
    mask = np.random.default_rng(2).uniform(0.3, 1, 15)
    params = upload(splats)
    logits = masked_logits(params["logit_opacities"], mi.Float(np.log(mask / (1 - mask))))
    expected = mask / (1 + np.exp(-splats.logit_opacities.astype(np.float64)))
    np.testing.assert_allclose(1 / (1 + np.exp(-logits.numpy().astype(np.float64))), expected, rtol=1e-5)
    frame = rasterize(
        params | {"logit_opacities": logits}, DeviceCamera.upload(camera), options(splats, **SMOOTH_OPTIONS)
    )
    got = np.stack([plane.numpy() for plane in frame.colors], -1).reshape(37, 45, 3)
    np.testing.assert_allclose(got, masked_images(splats, camera, mask, 0.0, smooth=True), atol=1e-4)


def test_lp_3dgs_masks_have_finite_gradients_at_opacities_that_float32_rounds_to_0_and_1():
    logits, mask_logits = (mi.Float([-60.0, -5.0, 0.0, 5.0, 60.0]) for _ in range(2))
    dr.enable_grad(logits, mask_logits)
    result = masked_logits(logits, mask_logits)
    dr.backward(dr.sum(result))
    sigmoid = 1 / (1 + np.exp(-np.array([-60.0, -5.0, 0.0, 5.0, 60.0])))
    # d logit(s²)/da for two equal factors s: (1 - s) / (1 - s²) = 1 / (1 + s)
    np.testing.assert_allclose(dr.grad(logits).numpy(), 1 / (1 + sigmoid), rtol=1e-5)
    np.testing.assert_allclose(dr.grad(mask_logits).numpy(), 1 / (1 + sigmoid), rtol=1e-5)


def test_gaussianspa_projects_on_the_nearest_sparse_vector():
    values = np.random.default_rng(0).uniform(0, 1, 6)
    got = projected(values, 2)
    candidates = [np.where(np.isin(np.arange(6), [i, j]), values, 0) for i in range(6) for j in range(i)]
    best = min(candidates, key=lambda z: float(np.sum((values - z) ** 2)))
    np.testing.assert_array_equal(got, best)


def test_taming_grows_along_the_parabola_of_the_paper():
    S, D, N = 1000, 9000, 145
    counts = [parabola(x / N, S, S + D) for x in range(N + 1)]
    assert counts == [round(-D * (x / N) ** 2 + 2 * D * (x / N) + S) for x in range(N + 1)]
    assert counts[0] == S and counts[-1] == S + D


@pytest.mark.parametrize("recipe", [taming.RECIPE, dash.RECIPE])
def test_growth_ends_densification_with_exactly_the_budget(trainer_of, recipe):
    trainer = trainer_of(recipe)
    assert trainer.optimizer.n == 45
    rows = list(run_to_end(trainer))
    counts = [row["n"] for row in rows]
    assert max(counts) == counts[-1] == 90 and rows[-1]["step"] == 60
    assert rows[-1]["test_psnr"] > 18
    photographs = trainer.photographs
    assert photographs.factor == 1 and photographs.cameras[0].width == trainer.dataset.train[0].camera.width


def test_dash_begins_with_small_pictures(trainer_of):
    trainer = trainer_of(dash.RECIPE)
    trainer.step()
    photographs = trainer.photographs
    assert photographs.factor > 1
    assert photographs.cameras[0].width == trainer.dataset.train[0].camera.width // photographs.factor


def test_dash_keeps_the_appearance_that_it_has_learned(trainer_of):
    trainer = trainer_of(dash.RECIPE, appearance=True)
    for _ in run_to_end(trainer):
        pass
    assert trainer.photographs.factor == 1 and sum(trainer.photographs.appearance.of_images.t) == 60


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mask_gaussian", "lp_3dgs", "gaussian_spa"])
def test_a_method_that_learns_more_goes_on_from_a_checkpoint_with_the_same_bits(trainer_of, name):
    """The one that goes on from it is stopped within the window in which its numbers are learned."""

    def trainer() -> Trainer:
        return trainer_of(METHODS[name].recipe, 120, target=20)

    first, second = trainer(), trainer()
    while first.step_count < 79:
        first.step()
    state = first.state()
    assert any(key.startswith("optimizer.") for key in state.keys() - trainer_of().state().keys())
    second.restore(state)
    for one in (first, second):
        while one.step_count < 120:
            one.step()
    if lanes_add_in_turn(mi.variant()):
        a, b = first.state(), second.state()
        assert a.keys() == b.keys() and all(np.array_equal(a[key], b[key]) for key in a if key != "seconds")
