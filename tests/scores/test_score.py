"""Importance scores: sums over views, their combination, and the spectral estimate against its exact value."""

import dataclasses

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from every_pair import every_pair
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.engine.rasterize import RasterOptions
from mi_dogsplat.engine.walks.slot_rows import lanes_add_in_turn
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scores.score import ScoreRule, band_pass_weight, energies, filtered_noise
from mi_dogsplat.scores.training_views import TrainingViews
from same_numbers import assert_same_numbers
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
SPLATS = rounded(random_splats(40, seed=1, degree=1))
CUT = rounded(random_splats(40, seed=1, degree=1, cut_share=0.5))
CUT_TWICE = rounded(random_splats(40, seed=1, degree=1, cut_share=0.5, second_cut_share=0.5))
CUT_SHARES = pytest.mark.parametrize("cuts", [{}, {"cut_share": 0.6}, {"cut_share": 0.6, "second_cut_share": 0.6}])
EXACT = ScoreRule(gamma_f=2, probes=0, spatial_weight=0.3, spectral_weight=0.7)


def score(rule: ScoreRule, splats: Splats = SPLATS, background=0.0, cameras=CAMERAS, seed=0, **others) -> np.ndarray:
    on_device = [DeviceCamera.upload(c) for c in cameras]
    return rule(upload(splats), TrainingViews(on_device, options(splats, **others), background), seed)


def footprints(splats: Splats = SPLATS, background=0.0, cameras=CAMERAS, **others) -> list[np.ndarray]:
    """J of each view, [N, 1, H, W]."""
    return [reference_score.footprints(splats, c, [background] * 3, **others)[:, None] for c in cameras]


def removals(splats: Splats = SPLATS, background=0.0, cameras=CAMERAS, **others) -> list[np.ndarray]:
    """D of each view, [N, 3, H, W]."""
    return [np.moveaxis(reference_score.removals(splats, c, [background] * 3, **others), -1, 1) for c in cameras]


def spatial(views: list[np.ndarray]) -> np.ndarray:
    return np.sum([(F**2).sum((1, 2, 3)) for F in views], 0)


def gradient(views: list[np.ndarray]) -> np.ndarray:
    return np.sum([reference_score.gradient_energy(F).sum(1) for F in views], 0)


def power(views: list[np.ndarray], gamma_f: float) -> np.ndarray:
    def energy(F):
        height, width = F.shape[-2:]
        return reference_score.spectral_energy(F, reference_score.power_weight(height, width, gamma_f)).sum(1)

    return np.sum([energy(F) for F in views], 0)


def combined(U: np.ndarray, Uf: np.ndarray, rule: ScoreRule) -> np.ndarray:
    return rule.spatial_weight * U / np.linalg.norm(U) + rule.spectral_weight * Uf / np.linalg.norm(Uf)


def assert_close(got: np.ndarray, expected: np.ndarray, rtol=1e-3):
    assert got.dtype == np.float64 and got.shape == expected.shape
    np.testing.assert_allclose(got, expected, rtol=rtol, atol=1e-7 * expected.max())


# Sums over views and their combination


@every_pair(
    splats=[SPLATS, CUT, CUT_TWICE], others=[{}, {"antialiased": True}, {"negative_transmittance": False}],
    background=[0.0, 1.0],
)  # fmt: skip
def test_the_spatio_spectral_score_is_the_weighted_sum_of_both_normalised_energies(splats, background, others):
    J = footprints(splats, background=background, **others)
    assert_close(score(EXACT, splats, background=background, **others), combined(spatial(J), gradient(J), EXACT))


@pytest.mark.parametrize("background", [0.0, 1.0])
@CUT_SHARES
def test_leave_one_out_combines_the_same_energies_of_real_removals(cuts, background):
    splats = rounded(random_splats(15, seed=7, degree=0, **cuts))  # few: no walk ends early
    D = removals(splats, background)
    rule = dataclasses.replace(EXACT, kind="leave-one-out")
    assert_close(score(rule, splats, background), combined(spatial(D), gradient(D), rule))
    alone = dataclasses.replace(rule, spectral_weight=0)
    assert_close(score(alone, splats, background), 0.3 * spatial(D) / np.linalg.norm(spatial(D)))


@pytest.mark.parametrize("background", [0.0, 1.0])
@CUT_SHARES
def test_leave_dog_out_is_the_energy_of_pictures_with_the_primary_alone(cuts, background):
    splats = rounded(random_splats(15, seed=7, degree=0, **cuts))
    views = []
    for camera in CAMERAS:
        image = reference.render(splats, camera, [background] * 3)[0]
        footprints = np.zeros((15, 3, camera.height, camera.width))
        for row, i in enumerate(splats.dog_index):
            others = np.delete(np.arange(splats.n_dog), row)
            names = "dog_index", "dog_logit_opacities", "dog_log_scales"
            dog = {name: getattr(splats, name)[others] for name in names}
            plain = reference.render(dataclasses.replace(splats, **dog), camera, [background] * 3)[0]
            footprints[i] = np.moveaxis(image - plain, -1, 0)
        views.append(footprints)
    rule = ScoreRule("leave-dog-out", spectral_weight=0)
    on_device = [DeviceCamera.upload(camera) for camera in CAMERAS]
    U, Uf = energies(rule, upload(splats), TrainingViews(on_device, options(splats), background), 0)
    assert_close(U, spatial(views))
    assert not Uf.any()  # no probe walks for what has no weight
    gaussians = np.setdiff1d(np.arange(15), splats.dog_index)
    assert not U[gaussians].any() and (U[splats.dog_index] > 0).sum() > 3


@pytest.mark.parametrize("background", [0.0, 1.0])
def test_the_released_score_is_of_the_clamped_image_with_pixels_weighted_by_the_band_pass_picture(background):
    splats = rounded(random_splats(40, seed=1, degree=1))
    splats.sh_coeffs[::4, 0] *= 3  # much of the picture is too bright or too dark
    pictures = [reference.render(splats, camera, [background] * 3)[0] for camera in CAMERAS]
    assert all(((picture < 0) | (picture > 1)).mean() > 0.05 for picture in pictures)
    weights = [band_pass_weight(np.clip(picture, 0, 1)) for picture in pictures]
    assert min(weight.max() for weight in weights) > 1.25
    J = footprints(splats, background, clamped=True)
    views = [weight * footprint for weight, footprint in zip(weights, J, strict=True)]
    got, expected = score(ScoreRule("released"), splats, background), spatial(views)
    assert_close(got, expected)
    assert (spatial(footprints(splats, background)) > 1.1 * spatial(J)).any()  # it matters


def test_the_band_pass_picture_follows_its_formula():
    image = np.random.default_rng(3).uniform(size=(18, 23, 3))
    luma = image @ [0.299, 0.587, 0.114]
    y, x = (np.minimum(np.arange(n), n - np.arange(n)) / n for n in (18, 23))
    r = np.sqrt(y[:, None] ** 2 + x**2) / np.sqrt(0.5)
    band = np.clip((r - 0.04) / 0.08, 0, 1) * np.clip((0.45 - r) / 0.15, 0, 1)
    inverse = reference_score.fourier((band * reference_score.fourier(luma)).conj()).conj() / luma.size
    W = np.clip(np.abs(inverse) / np.abs(inverse).mean(), 0, 3)
    np.testing.assert_allclose(band_pass_weight(image), 1 + 0.1 * W, rtol=1e-9)
    assert (W == 3).any()
    np.testing.assert_allclose(band_pass_weight(np.full((5, 4, 3), 0.7)), 1, atol=1e-3)


def test_the_opacity_needs_no_view():
    splats = make_splats(np.zeros((4, 3)), opacities=[0.1, 0.7, 1e-9, 0.5])
    splats.logit_opacities[3] = np.nan
    assert_close(score(ScoreRule("opacity"), rounded(splats), cameras=[]), np.array([0.1, 0.7, 1e-9, 0]), rtol=1e-6)


def test_opacities_of_infinite_logits_are_0_and_1_as_they_are_drawn_and_of_none_0():
    splats = dataclasses.replace(select(SPLATS, 3), logit_opacities=np.array([np.inf, -np.inf, np.nan]))
    np.testing.assert_array_equal(score(ScoreRule("opacity"), splats, cameras=[]), [1, 0, 0])


@pytest.mark.parametrize("rule", [EXACT, ScoreRule(), ScoreRule("released"), ScoreRule("leave-one-out")])
def test_what_no_camera_sees_is_worth_nothing_and_all_else_something(rule):
    splats = rounded(make_splats([[0, 0, -2], [0, 0, 2], [50, 0, 2], [0.1, 0, 3]], 0.2, 0.5))
    splats.means[1] = np.nan
    got = score(rule, splats, cameras=[make_camera()])
    assert got[3] > 0 and not got[:3].any()
    assert not score(rule, splats.select(np.arange(3)), cameras=[make_camera()]).any()


@pytest.mark.parametrize("n", [0, 1])
def test_any_number_of_primitives_has_scores(n):
    splats = rounded(make_splats(np.tile([0, 0, 2.0], (n, 1))))
    for rule in (EXACT, ScoreRule(), ScoreRule("released"), ScoreRule("opacity"), ScoreRule("leave-one-out", probes=3)):
        got = score(rule, splats, cameras=[make_camera()])
        assert got.shape == (n,) and got.dtype == np.float64 and (got > 0).all()


def test_attached_parameters_are_left_alone():
    params = attached(SPLATS)
    views = TrainingViews([DeviceCamera.upload(c) for c in CAMERAS], options(SPLATS))
    assert_same_numbers(EXACT(params, views, 0), score(EXACT))
    assert dr.grad_enabled(params["means"]) and not dr.grad(params["means"]).numpy().any()


@pytest.mark.parametrize(
    "choices, message",
    [
        ({"kind": "magic"}, "magic"),
        ({"spatial_weight": -1.0}, "negative"),
        ({"spatial_weight": -1.0, "spectral_weight": 2.0}, "negative"),  # though they add up to more than 0
        ({"probes": -1}, "probes=-1"),
        ({"spatial_weight": 0.0, "spectral_weight": 0.0}, "positive"),
        ({"gamma_f": 0.0}, "gamma_f=0"),
        ({"probes": 0, "gamma_f": 1.5}, "gamma_f=1.5"),
        ({"spatial_weight": float("nan")}, "nan"),
    ],
)
def test_numbers_that_mean_nothing_are_refused(choices, message):
    with pytest.raises(ValueError, match=message):
        ScoreRule(**choices)


def test_a_score_of_views_needs_a_view():
    with pytest.raises(ValueError, match="released.*camera"):
        ScoreRule("released")(upload(SPLATS), TrainingViews([], RasterOptions()), 0)


# The spectral estimate


def test_noise_is_filtered_as_in_the_twin_at_every_image_size():
    for shape in ((1, 1), (1, 7), (8, 1), (6, 5), (9, 16)):
        z = np.random.default_rng(0).normal(size=(2, *shape))
        for gamma_f in (0.5, 1, 2):
            np.testing.assert_allclose(filtered_noise(z, gamma_f), reference_score.filtered(z, gamma_f), atol=1e-12)


class Walsh:
    """Stands for a random generator: over H W probes its signs are exactly uncorrelated, as random ones on average."""

    def __init__(self):
        self.signs = np.ones((1, 1))
        while len(self.signs) < 64:
            self.signs = np.kron(self.signs, [[1, 1], [1, -1]])

    def integers(self, low: int, high: int, shape: tuple) -> np.ndarray:
        assert (low, high, shape) == (0, 2, (64, 8, 8))
        return ((self.signs + 1) / 2).reshape(shape)


@pytest.mark.parametrize("gamma_f", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("background", [0.0, 1.0])
def test_over_uncorrelated_signs_the_estimate_is_the_sum_over_frequencies(monkeypatch, gamma_f, background):
    """Only E[z zᵀ] = 1 enters the expected value: the estimate is unbiased."""
    monkeypatch.setattr(np.random, "default_rng", lambda seed: Walsh())
    camera = tilted_camera(8, 8, f=8.0)
    rule = ScoreRule(gamma_f=gamma_f, probes=64)
    views = TrainingViews([DeviceCamera.upload(camera)], options(SPLATS), background)
    got = energies(rule, upload(SPLATS), views, 0)
    J = footprints(background=background, cameras=[camera])
    assert_close(got[0], spatial(J))
    assert_close(got[1], power(J, gamma_f))


@pytest.mark.parametrize(
    "kind, probes", [("spatio-spectral", 1), ("spatio-spectral", 8), ("leave-one-out", 2)]
)
def test_random_signs_give_the_sum_over_frequencies_with_an_error_of_one_over_root_probes(kind, probes):
    cameras, count = [tilted_camera(14, 11, f=12.0), make_camera(9, 12, f=9.0)], 150
    views = (footprints if kind == "spatio-spectral" else removals)(cameras=cameras)
    exact = power(views, 1.0)
    seen = exact > 1e-3 * exact.max()
    assert seen.sum() > 20
    variance = np.sum([reference_score.probe_variance(F) for F in views], 0)[seen] / probes
    rule = ScoreRule(kind, spatial_weight=0, probes=probes)
    on_device, params = TrainingViews([DeviceCamera.upload(c) for c in cameras], options(SPLATS)), upload(SPLATS)
    got = np.stack([energies(rule, params, on_device, seed)[1][seen] for seed in range(count)])
    error = (got.mean(0) - exact[seen]) / np.sqrt(variance / count)  # in standard deviations
    assert np.abs(error).max() < 5 and np.sqrt((error**2).mean()) < 1.5
    ratio = (got.var(0) / variance).mean()
    assert 0.75 < ratio < 1.25, f"the variance is {ratio:.2f} of what it should be"


@pytest.mark.usefixtures("all_cores")
@pytest.mark.parametrize("rule", [EXACT, ScoreRule(probes=2), ScoreRule("leave-one-out"), ScoreRule("released")])
def test_the_seed_decides_and_every_run_has_the_same_bits_where_lanes_add_in_turn(rule):
    splats = rounded(random_splats(500, seed=2, degree=0))
    first, again, other = (score(rule, splats, cameras=[tilted_camera(200, 150, f=180.0)], seed=k) for k in (3, 3, 4))
    in_turn = lanes_add_in_turn(mi.variant())  # else atomics add in any order, in float32
    rtol = 0 if in_turn else 1e-5
    np.testing.assert_allclose(first, again, rtol=rtol)
    noisy = rule.kind != "released" and rule.probes > 0
    assert np.allclose(first, other, rtol=rtol, atol=0) == (not noisy)
    assert np.abs(first - other).max() > 1e-2 or not noisy


# Cost


@pytest.mark.parametrize(
    "rule",
    [
        EXACT,
        ScoreRule(),
        ScoreRule("released"),
        ScoreRule("leave-one-out", spectral_weight=0),
    ],
    ids=lambda rule: rule.kind,
)
@pytest.mark.parametrize("dog_share", [0, 0.5])
def test_no_kernel_is_compiled_whatever_the_number_of_primitives(rule, dog_share):
    model, cameras = random_splats(1000, seed=1, dog_share=dog_share), [tilted_camera(), tilted_camera(40, 30)]
    known = kernels(lambda: [score(rule, select(model, n), cameras=cameras) for n in (100, 101)])
    for n in (100, 137, 500, 12, 1000):
        new = kernels(lambda n=n: score(rule, select(model, n), cameras=cameras)) - known
        assert not new, f"N = {n}: {len(new)} new kernels"
