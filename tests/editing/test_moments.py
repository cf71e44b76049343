"""Merged primitives have the moments of what they were made of, and hide as much."""

import numpy as np
import pytest
from mi_dogsplat.editing.moments import MOST_OPACITY, Clusters, merged, shadows
from mi_dogsplat.scene.splats import Splats
from splat_scenes import image_of, logit, make_splats, random_splats, rasterized, rounded, tilted_camera


def clusters(n=6, seed=0) -> Clusters:
    return Clusters.of(rounded(random_splats(n, seed=seed, degree=1, dog_share=0)))


def density_moments(parts: Clusters) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, mean and covariance of the mixture density, by quadrature over a grid."""
    reach = 7 * np.sqrt(np.linalg.eigvalsh(parts.covariances).max())
    low, high = parts.means.min(0) - reach, parts.means.max(0) + reach
    axes = [np.linspace(a, b, 121) for a, b in zip(low, high, strict=True)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    density = np.zeros(len(x))
    for w, mean, cov in zip(parts.weights, parts.means, parts.covariances, strict=True):
        exponent = np.einsum("ni,ij,nj->n", x - mean, np.linalg.inv(cov), x - mean)
        density += w * np.exp(-exponent / 2) / np.sqrt((2 * np.pi) ** 3 * np.linalg.det(cov))
    cell = np.prod([axis[1] - axis[0] for axis in axes])
    mass = density.sum() * cell
    mean = (density[:, None] * x).sum(0) * cell / mass
    d = x - mean
    return mass, mean, np.einsum("n,ni,nj->ij", density, d, d) * cell / mass


def test_two_become_one_of_the_same_moments():
    parts = Clusters(
        np.array([2.0, 0.5]),
        np.ones(2),
        np.array([[0, 0, 0], [0.5, -0.3, 0.2]]),
        np.array([np.diag([0.09, 0.16, 0.04]), [[0.1, 0.03, 0], [0.03, 0.08, -0.01], [0, -0.01, 0.05]]]),
        np.zeros((2, 1, 3)),
    )
    one = merged(parts.select(np.array([0])), parts.select(np.array([1])))
    mass, mean, covariance = density_moments(parts)
    assert one.weights[0] == pytest.approx(mass, rel=1e-6)
    assert one.means[0] == pytest.approx(mean, abs=1e-6)
    assert one.covariances[0] == pytest.approx(covariance, abs=1e-6)


def test_the_order_of_merging_does_not_matter():
    a, b, c = (clusters().select(np.array([k])) for k in range(3))
    left, right = merged(merged(a, b), c), merged(a, merged(c, b))
    for x, y in zip(vars(left).values(), vars(right).values(), strict=True):
        assert x == pytest.approx(y, rel=1e-12, abs=1e-14)


def test_a_colour_is_the_mean_by_weight():
    first, second = clusters().select(np.array([0])), clusters().select(np.array([1]))
    share = first.weights / (first.weights + second.weights)
    expected = share * first.sh_coeffs + (1 - share) * second.sh_coeffs
    assert merged(first, second).sh_coeffs == pytest.approx(expected)


def test_clusters_of_single_primitives_are_those_again():
    splats = rounded(random_splats(30, degree=1, dog_share=0))
    back = Clusters.of(splats).splats()
    camera = tilted_camera()
    before, after = (image_of(rasterized(model, camera), camera) for model in (splats, back))
    assert abs(after - before).max() < 2e-5


def test_two_at_one_place_block_what_both_did():
    first, second = (Clusters.of(rounded(make_splats([[0, 0, 2]], [0.1, 0.2, 0.3], o))) for o in (0.3, 0.6))
    assert merged(first, second).splats().opacities[0] == pytest.approx(1 - 0.7 * 0.4, rel=1e-5)


def test_two_side_by_side_are_fainter_over_more():
    first, second = (Clusters.of(rounded(make_splats([[x, 0, 2]], 0.1, 0.5))) for x in (-0.5, 0.5))
    one = merged(first, second).splats()
    absorbance = -np.log(1 - one.opacities[0]) * shadows(one.scales)[0]
    assert one.opacities[0] < 0.5
    assert absorbance == pytest.approx(2 * np.log(2) * 0.01, rel=1e-5)


def test_a_shadow_is_the_mean_over_all_directions():
    """Oracle: the area of an ellipsoid's shadow along u is π abc |diag(1/a, 1/b, 1/c) u|, here over 100,000 u."""
    scales = np.array([[1, 1, 1], [1, 0.5, 0.2], [1, 0.3, 1e-3], [1, 1, 1e-3], [1, 0.01, 0.01]])
    u = np.random.default_rng(0).normal(size=(100_000, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    true = [np.prod(s) * np.linalg.norm(u / s, axis=1).mean() for s in scales]
    assert shadows(scales) == pytest.approx(true, rel=0.015)


@pytest.mark.parametrize("opacity", [logit(1 - 1e-9), 60.0, np.inf])
def test_the_opaque_and_the_flat_stay_finite(opacity):
    flat = rounded(make_splats([[0, 0, 2]] * 2, [0.1, 0.1, 1e-30], 0.5))
    flat.logit_opacities[:] = opacity
    both = Clusters.of(flat)
    one = merged(both.select(np.array([0])), both.select(np.array([1]))).splats()
    assert all(np.isfinite(values).all() for values in vars(one).values())
    assert one.opacities[0] == pytest.approx(MOST_OPACITY, rel=1e-6)


def test_no_cluster_is_no_primitive():
    assert Clusters.of(Splats.empty(1)).splats().n_splats == 0
