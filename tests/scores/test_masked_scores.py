"""Scores where masks paint pixels black: those of footprints without these pixels, by brute force."""

import numpy as np
import pytest
from mi_dogsplat import reference
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.parameters import upload
from mi_dogsplat.reference import score as reference_score
from mi_dogsplat.scores.bands import bands
from mi_dogsplat.scores.score import ScoreRule, band_pass_weight, energies, filtered_noise
from mi_dogsplat.scores.slope_losses import slope_losses
from mi_dogsplat.scores.training_views import TrainingViews, whole
from splat_scenes import make_camera, make_splats, options, random_splats, rounded, tilted_camera

CAMERAS = [tilted_camera(45, 37), make_camera(20, 33, f=25.0)]
SPLATS = rounded(random_splats(15, seed=7, degree=1, dog_share=0.4))
ROOM = np.random.default_rng(3)
MASKS = [(ROOM.uniform(size=(camera.height, camera.width)) > 0.4).astype(np.float32) for camera in CAMERAS]
BACKGROUND = 0.7


def on_device(cameras=CAMERAS) -> list[DeviceCamera]:
    return [DeviceCamera.upload(camera) for camera in cameras]


def measured(rule: ScoreRule, mask=whole) -> tuple[np.ndarray, np.ndarray]:
    return energies(rule, upload(SPLATS), TrainingViews(on_device(), options(SPLATS), BACKGROUND, mask), 5)


def footprints(clamped=False) -> list[np.ndarray]:
    return [reference_score.footprints(SPLATS, c, [BACKGROUND] * 3, clamped=clamped) for c in CAMERAS]


def assert_close(got, expected):
    np.testing.assert_allclose(got, expected, rtol=1e-3, atol=1e-6 * np.max(expected))


def test_the_energies_are_those_of_masked_footprints():
    J = [m * F for m, F in zip(MASKS, footprints(), strict=True)]
    U, Uf = measured(ScoreRule(gamma_f=2, probes=0), MASKS.__getitem__)
    assert_close(U, sum((F**2).sum((1, 2)) for F in J))
    assert_close(Uf, sum(reference_score.gradient_energy(F) for F in J))
    assert (U < 0.9 * measured(ScoreRule(gamma_f=2, probes=0))[0]).any()


def test_a_view_without_a_mask_counts_whole_beside_one_that_has_one():
    J = footprints()
    U, _ = measured(ScoreRule(spectral_weight=0), lambda k: MASKS[1] if k else None)
    assert_close(U, (J[0] ** 2).sum((1, 2)) + ((MASKS[1] * J[1]) ** 2).sum((1, 2)))


def test_a_probe_meets_the_masked_footprint():
    rng, expected = np.random.default_rng(5), np.zeros(SPLATS.n_splats)
    for m, F in zip(MASKS, footprints(), strict=True):
        signs = 2.0 * rng.integers(0, 2, (1, *m.shape)) - 1
        expected += (filtered_noise(signs, 1.0) * m * F).sum((1, 2)) ** 2
    assert_close(measured(ScoreRule(spatial_weight=0), MASKS.__getitem__)[1], expected)


def test_the_released_score_and_removals_are_masked_too():
    pictures = [np.clip(reference.render(SPLATS, c, [BACKGROUND] * 3)[0], 0, 1) for c in CAMERAS]
    J = [m * band_pass_weight(p) * F for m, p, F in zip(MASKS, pictures, footprints(clamped=True), strict=True)]
    assert_close(measured(ScoreRule("released"), MASKS.__getitem__)[0], sum((F**2).sum((1, 2)) for F in J))
    D = [reference_score.removals(SPLATS, c, [BACKGROUND] * 3) for c in CAMERAS]
    expected = sum(((m[..., None] * F) ** 2).sum((1, 2, 3)) for m, F in zip(MASKS, D, strict=True))
    assert_close(measured(ScoreRule("leave-one-out", spectral_weight=0), MASKS.__getitem__)[0], expected)


@pytest.mark.parametrize("kind", ["spatio-spectral", "leave-one-out", "released"])
def test_what_shows_in_black_pixels_alone_is_worth_nothing(kind):
    splats = rounded(make_splats([[-0.8, 0, 4], [0.8, 0, 4]], 0.1, 0.9, np.full((2, 3), 0.8)))
    camera = make_camera()
    mask = np.zeros((camera.height, camera.width))
    mask[:, camera.width // 2 :] = 1
    views = TrainingViews(on_device([camera]), options(splats), mask=lambda _: mask)
    found = ScoreRule(kind)(upload(splats), views, 0)
    assert found[0] == 0 < found[1]


def test_bands_and_slopes_are_sums_over_the_pixels_that_count():
    """So those of a mask and of its complement add up to the whole."""
    splats = rounded(random_splats(15, seed=2, degree=1, slope_share=1.0))
    params, rest = upload(splats), [1 - m for m in MASKS]
    masks = whole, MASKS.__getitem__, rest.__getitem__
    views = [TrainingViews(on_device(), options(splats), mask=mask) for mask in masks]
    slopes = [slope_losses(params, some) for some in views]
    first = [bands(params, splats.sh_coeffs, some).H for some in views[:2]]
    assert_close(slopes[1] + slopes[2], slopes[0])
    assert (slopes[1] > 0).sum() > 9 and (slopes[2] > 0).sum() > 9
    h = sum(((m * reference_score.weights(splats, c)[0]) ** 2).sum((1, 2)) for m, c in zip(MASKS, CAMERAS, strict=True))
    assert_close(first[1][0], h / (4 * np.pi))  # the basis function of degree 0, squared
    assert (first[1][0] < first[0][0]).any()
