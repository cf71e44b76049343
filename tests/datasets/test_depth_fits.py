"""What the values of a depth map mean: lines to sparse points, of which some are wrong, against brute force."""

from itertools import combinations

import numpy as np
import pytest
from mi_dogsplat.datasets.depth_fits import UNCLEAR, Fit, Samples, depth_correlation, fitted
from scipy.stats import spearmanr

SCALE, OFFSET = 0.7, -0.11


def seen(rng: np.random.Generator, n: int, wrong: float = 0.0, bits: int = 16) -> tuple[Samples, np.ndarray]:
    """A map of inverse depth in whole numbers at ``n`` points, and the true depths of these; the share ``wrong`` of the
    points is somewhere else."""
    z = np.exp(rng.uniform(np.log(1.5), np.log(20), n))
    values = np.rint((1 / z - OFFSET) / SCALE * (2**bits - 1)) / (2**bits - 1)
    moved = z.copy()
    moved[: round(wrong * n)] = rng.uniform(0.5, 40, round(wrong * n))
    return Samples(values, moved), z


def least_median(samples: Samples) -> tuple[float, float]:
    """(scale, offset) of the line through two points whose median error at all is least, by trying all pairs (LMedS,
    Rousseeuw 1984), in float64."""
    lines = []
    for a, b in combinations(range(len(samples.z)), 2):
        if samples.values[a] != samples.values[b]:
            slope = (1 / samples.z[a] - 1 / samples.z[b]) / (samples.values[a] - samples.values[b])
            lines.append((slope, 1 / samples.z[a] - slope * samples.values[a]))
    errors = [np.median(np.abs(samples.z * (slope * samples.values + offset) - 1)) for slope, offset in lines]
    return lines[int(np.argmin(errors))]


@pytest.mark.parametrize("wrong", [0, 0.2, 0.4])
def test_the_line_is_that_of_the_best_pair_however_many_points_are_wrong(wrong):
    samples, z = seen(np.random.default_rng(1), 60, wrong)
    fit, (scale, offset) = fitted(samples, inverse=True), least_median(samples)
    np.testing.assert_allclose(fit.depth(samples.values), 1 / (scale * samples.values + offset), rtol=2e-3)
    np.testing.assert_allclose(fit.depth(samples.values), z, rtol=2e-3)
    error = np.median(np.abs(fit.depth(samples.values) / samples.z - 1))
    assert fit.error == pytest.approx(error) and fit.error < 0.01


@pytest.mark.parametrize("somewhere", [0.3, 200.0])
def test_points_that_are_wrong_together_do_not_draw_the_line_to_them(somewhere):
    """As where something transparent, or a reflection, has been matched. Least squares of the right ones are the
    oracle."""
    rng = np.random.default_rng(6)
    samples, z = seen(rng, 300)
    noisy = z * np.exp(rng.normal(0, 0.02, 300))
    design = np.column_stack([noisy * samples.values, noisy])[120:]
    scale, offset = np.linalg.lstsq(design, np.ones(180), rcond=None)[0]
    noisy[:120] = somewhere
    found = fitted(Samples(samples.values, noisy), inverse=True).depth(samples.values)
    np.testing.assert_allclose(found, 1 / (scale * samples.values + offset), rtol=0.01)


@pytest.mark.parametrize("n", [20, 3000])
def test_eight_bits_are_as_exact_as_their_steps(n):
    samples, z = seen(np.random.default_rng(2), n, 0.3, bits=8)
    step = SCALE / 255  # of inverse depth
    off = np.abs(1 / fitted(samples, inverse=True).depth(samples.values) - 1 / z)
    assert off.max() < 2 * step


def test_depth_is_scaled_by_the_median():
    rng = np.random.default_rng(3)
    values = rng.uniform(1, 2, 51)
    z = 3.7 * values
    z[:20] = rng.uniform(1, 50, 20)
    fit = fitted(Samples(values, z), inverse=False)
    assert fit == Fit(pytest.approx(3.7), 0.0, False, pytest.approx(0.0, abs=1e-12))  # pyright: ignore[reportArgumentType]


def test_a_map_that_says_nothing_of_its_points_has_an_error():
    rng = np.random.default_rng(4)
    samples, z = seen(rng, 200)
    for values in (np.ones(200), rng.permutation(samples.values)):
        assert fitted(Samples(values, z), inverse=True).error > 0.3
    assert fitted(Samples(z, z), inverse=True).error == np.inf  # it is depth: the line would fall


def test_values_that_say_behind_the_camera_are_unknown():
    values = np.array([0, 0.1, 0.157, 0.2, 1], np.float32)
    depth = Fit(SCALE, OFFSET, inverse=True).depth(values)
    np.testing.assert_allclose(depth, [0, 0, 0, 1 / (0.14 - 0.11), 1 / 0.59], rtol=1e-4)
    assert depth.dtype == np.float32
    np.testing.assert_array_equal(Fit(2.0, 0.0, inverse=False).depth(values), 2 * values)


@pytest.mark.parametrize("bits", [3, 16])
def test_the_correlation_is_that_of_ranks_within_each_map(bits):
    rng = np.random.default_rng(5)
    samples, _ = seen(rng, 80, 0.3, bits)
    expected = spearmanr(samples.values, samples.z).statistic  # pyright: ignore[reportAttributeAccessIssue]
    assert depth_correlation([samples]) == pytest.approx(expected, abs=1e-12)
    assert expected < -UNCLEAR
    others = [Samples(k + 0.1 * k * samples.values, samples.z) for k in (1, 10, 100)]  # other lines, the same ranks
    assert depth_correlation(others) == pytest.approx(expected, abs=1e-12)
    assert depth_correlation([Samples(np.ones(80), samples.z)]) == 0
