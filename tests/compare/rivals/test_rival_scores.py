"""Scores of rivals against brute force: every primitive at every pixel, in float64."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.compare.rivals.lightgaussian import GlobalSignificance
from mi_dogsplat.compare.rivals.mini_splatting import SummedWeight, sampling_keys
from mi_dogsplat.compare.rivals.pup import Sensitivity, fisher
from mi_dogsplat.compare.rivals.radsplat import LargestWeight
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.scene.sh_basis import C0
from mi_dogsplat.scores.training_views import TrainingViews
from mi_dogsplat.support.srgb import linear_to_srgb_log
from mi_dogsplat.training.images.tone_curve import SrgbLog
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


@pytest.mark.parametrize("rule", [LargestWeight(), GlobalSignificance(), SummedWeight(), Sensitivity()])
def test_what_masks_paint_black_no_score_sees(rule):
    splats = rounded(make_splats([[-0.5, 0, 2], [0.5, 0, 2]], 0.05, 0.5))
    camera = make_camera()
    mask = np.ones((camera.height, camera.width), np.float32)
    mask[:, camera.width // 2 :] = 0
    views = TrainingViews([DeviceCamera.upload(camera)], options(splats), 0.0, lambda _: mask)
    seen, masked = rule(upload(splats), views, 0)
    whole = score(rule, splats, [camera])[0]
    assert seen == pytest.approx(whole, rel=1e-4) and masked in (0, -np.inf)


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


def brute_force_fisher(splats, cameras, background: float, masks, eps=1e-5, curve=np.asarray) -> np.ndarray:
    """Central differences of whole pictures by each mean and log scale; sums of patches; products."""
    names = ("means", "log_scales", "quats", "logit_opacities", "sh_coeffs", "dog_logit_opacities", "dog_log_scales")
    raw: dict[str, Any] = {name: np.array(getattr(splats, name), np.float64) for name in names}
    raw["dog_index"] = splats.dog_index
    total = np.zeros((splats.n_splats, 6, 6))
    for camera, mask in zip(cameras, masks, strict=True):
        rows, columns = -(-camera.height // 4), -(-camera.width // 4)

        def patch_sums(rows=rows, columns=columns, camera=camera, mask=mask) -> np.ndarray:
            image = reference.render(SimpleNamespace(**raw), camera, [background] * 3, smooth=True)[0]  # type: ignore
            image = curve(image)
            padded = np.zeros((4 * rows, 4 * columns, 3))
            padded[: camera.height, : camera.width] = image if mask is None else image * mask[..., None]
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


@pytest.mark.parametrize(("background", "masked"), [(0.0, False), (1.0, False), (1.0, True)])
def test_pup_is_the_log_determinant_of_squared_derivatives_of_patches(background, masked):
    splats, cameras = (
        rounded(random_splats(8, seed=3, degree=1, dog_share=0)),
        [tilted_camera(22, 17), make_camera(19, 26, f=25.0)],
    )
    splats.logit_opacities[[0, 3]] = 6  # beyond the limit of .99 near the centre
    mask = (np.random.default_rng(0).uniform(size=(26, 19)) > 0.3).astype(np.float32) if masked else None
    masks = [None, mask]
    expected = brute_force_fisher(splats, cameras, background, masks)
    on_device = [DeviceCamera.upload(camera) for camera in cameras]
    views = TrainingViews(on_device, options(splats, **SMOOTH_OPTIONS), background, masks.__getitem__)
    got = fisher(upload(splats), views)
    scale = np.sqrt(np.einsum("nii->ni", expected))
    assert (scale > 1e-3).all(1).sum() >= 6
    error = np.abs(got - expected) / np.maximum(scale[:, :, None] * scale[:, None, :], 1e-6)
    assert error.max() < 2e-3, error.max((1, 2))
    log_det = np.linalg.slogdet(expected)[1]
    scores = Sensitivity()(upload(splats), views, 0)
    least = np.linalg.eigvalsh(expected / (scale[:, :, None] * scale[:, None, :]))[:, 0]
    sound = least > 1e-5  # else float32 cannot tell
    assert sound.sum() >= 3 and np.isfinite(scores).all()
    np.testing.assert_allclose(scores[sound], log_det[sound], atol=0.1)


def test_pup_of_linear_pictures_is_that_of_what_the_loss_sees_of_them():
    splats = rounded(random_splats(8, seed=3, degree=1, dog_share=0))
    grey = splats.sh_coeffs[..., :1] + np.float32(5 / C0) * (np.arange(4) == 0)[:, None]
    splats.sh_coeffs[:] = grey * np.geomspace(0.02, 1, 8)[:, None, None]  # the slope of the curve is the same of all
    camera = tilted_camera(22, 17)
    expected = brute_force_fisher(splats, [camera], 0.5, [None], curve=linear_to_srgb_log)
    options_of = options(splats, **SMOOTH_OPTIONS)
    views = TrainingViews([DeviceCamera.upload(camera)], options_of, 0.5, curve=SrgbLog())
    scale = np.sqrt(np.einsum("nii->ni", expected))
    error = np.abs(fisher(upload(splats), views) - expected) / np.maximum(scale[:, :, None] * scale[:, None, :], 1e-6)
    assert (scale > 1e-3).all(1).sum() >= 4 and error.max() < 2e-3, error.max((1, 2))


def test_pup_puts_what_no_view_shows_last():
    splats = rounded(make_splats([[0, 0, -2], [0.2, 0, 2], [50, 0, 2]], 0.2, 0.5))
    got = score(Sensitivity(), splats)
    assert np.isfinite(got[1]) and np.isneginf(got[[0, 2]]).all()
