"""Which primitives are merged: the cheapest pairs by a cost that bounds what is lost; and how many are left."""

from itertools import combinations

import numpy as np
import pytest
from mi_dogsplat.editing.merge import COLOR_DEVIATION, candidate_pairs, cheapest_disjoint, merge, pair_costs
from mi_dogsplat.editing.moments import Clusters, merged
from mi_dogsplat.scene.splats import Splats
from splat_scenes import C0, make_splats, random_splats, rounded

RESOLUTION = 1e-3


def splats(n=12, seed=0) -> Splats:
    return rounded(random_splats(n, seed=seed, degree=1, dog_share=0))


def brute_cost(clusters: Clusters, i: int, j: int, resolution: float) -> float:
    """The formula of the module, with one pair at a time."""
    w1, w2 = clusters.weights[[i, j]]
    one = merged(clusters.select(np.array([i])), clusters.select(np.array([j])))
    sizes = [
        np.linalg.slogdet(cov + resolution**2 * np.eye(3))[1]
        for cov in (one.covariances[0], *clusters.covariances[[i, j]])
    ]
    difference = clusters.sh_coeffs[i] - clusters.sh_coeffs[j]
    color = w1 * w2 / (w1 + w2) * (difference**2).sum() / (4 * np.pi * COLOR_DEVIATION**2)
    return 0.5 * ((w1 + w2) * sizes[0] - w1 * sizes[1] - w2 * sizes[2] + color)


def test_pairs_and_costs_are_those_of_a_brute_force_search():
    clusters = Clusters.of(splats())
    first, second, costs = candidate_pairs(clusters, RESOLUTION, neighbours=11)
    assert list(zip(first, second, strict=True)) == list(combinations(range(12), 2))
    assert costs == pytest.approx([brute_cost(clusters, i, j, RESOLUTION) for i, j in combinations(range(12), 2)])


def test_candidates_are_the_nearest():
    clusters = Clusters.of(splats(60))
    first, second, _ = candidate_pairs(clusters, RESOLUTION, neighbours=4)
    distances = np.linalg.norm(clusters.means[:, None] - clusters.means, axis=2)
    near = {(min(i, j), max(i, j)) for i in range(60) for j in np.argsort(distances[i])[1:5]}
    assert set(zip(first.tolist(), second.tolist(), strict=True)) == near


@pytest.mark.parametrize("most", [1, 7, 20])
def test_the_cheapest_pairs_are_chosen_each_end_once(most):
    """Oracle: again and again the cheapest pair of those whose ends are both left."""
    all_first, all_second, costs = candidate_pairs(Clusters.of(splats(40)), RESOLUTION)
    first, second = all_first.tolist(), all_second.tolist()
    left, expected = set(range(40)), []
    while len(expected) < most:
        free = [p for p in range(len(costs)) if {first[p], second[p]} <= left]
        if not free:
            break
        expected.append(min(free, key=lambda p: costs[p]))
        left -= {first[expected[-1]], second[expected[-1]]}
    assert cheapest_disjoint(all_first, all_second, costs, most).tolist() == expected
    assert len(expected) >= min(most, 13)


def test_of_equal_costs_the_first_pair_is_taken():
    first, second = np.array([0, 0, 1]), np.array([1, 2, 2])
    assert cheapest_disjoint(first, second, np.ones(3), 3).tolist() == [0]


def test_the_cost_is_above_the_divergence():
    """Oracle: the Kullback-Leibler divergence of the mixture from its merged Gaussian, by quadrature along a line."""
    x = np.linspace(-12, 12, 4001)

    def bump(mean, deviation):
        return np.exp(-((x - mean) ** 2) / 2 / deviation**2) / deviation / np.sqrt(2 * np.pi)

    for distance, weight in ((0.5, 0.5), (2.0, 0.3), (4.0, 0.8)):
        parts = rounded(make_splats([[0, 0, 0], [distance, 0, 0]], 1.0, 0.5))
        clusters = Clusters.of(parts, np.array([weight, 1 - weight]))
        cost = pair_costs(clusters, np.zeros(2), np.array([[0, 1]]), 1e-9)[0]  # log|I| is 0
        mean = (1 - weight) * distance
        mixture = weight * bump(0, 1) + (1 - weight) * bump(distance, 1)
        one = bump(mean, np.sqrt(1 + weight * (1 - weight) * distance**2))
        divergence = (mixture * np.log(mixture / one)).sum() * (x[1] - x[0])
        assert 0 < divergence < cost


def test_alike_at_one_place_costs_nothing_and_more_apart_costs_more():
    def cost(x=0.0, color=0.5):
        pair = rounded(make_splats([[0, 0, 0], [x, 0, 0]], 0.1, 0.5, [[0.5] * 3, [color] * 3]))
        return candidate_pairs(Clusters.of(pair), RESOLUTION)[2][0]

    assert cost() == pytest.approx(0, abs=1e-12)
    assert 0 < cost(0.05) < cost(0.1) < cost(0.3)
    assert 0 < cost(color=0.6) < cost(color=0.9)


@pytest.mark.parametrize("target", [1, 2, 17, 39])
def test_so_many_are_left_as_asked_for_and_what_adds_up_stays(target):
    before = splats(40)
    after = merge(before, target, RESOLUTION)
    assert after.n_splats == target and after.sh_degree == 1
    assert all(np.isfinite(values).all() for values in vars(after).values())
    everything = Clusters.of(before)
    mean = everything.weights @ everything.means / everything.weights.sum()
    if target == 1:
        assert after.means[0] == pytest.approx(mean, rel=1e-5)
        spread = everything.means - mean
        covariance = np.einsum("n,nij->ij", everything.weights, everything.covariances)
        covariance += np.einsum("n,ni,nj->ij", everything.weights, spread, spread)
        scales = np.sqrt(np.linalg.eigvalsh(covariance / everything.weights.sum()))
        assert np.sort(after.scales[0]) == pytest.approx(scales, rel=1e-4)


def test_nothing_is_merged_where_there_is_no_more_than_the_target():
    before = splats(5)
    assert merge(before, 5, RESOLUTION) is before
    with pytest.raises(ValueError, match="the target is 0"):
        merge(before, 0, RESOLUTION)


def test_a_crowd_at_one_place_is_merged():
    """More of them than neighbours are looked at: an index need not be among its own."""
    crowd = rounded(make_splats(np.zeros((100, 3)), 0.1, 0.5))
    assert merge(crowd, 3, RESOLUTION).n_splats == 3


def test_colours_do_not_bleed_over_an_edge():
    x, y = np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 20))
    means = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1)
    colors = np.where(means[:, :1] < 0, [1.0, 0, 0], [0, 0, 1.0])
    sheet = rounded(make_splats(means, [0.05, 0.05, 0.001], 0.9, colors))
    few = merge(sheet, 20, RESOLUTION)
    shown = 0.5 + C0 * few.sh_coeffs[:, 0]
    assert np.minimum(shown[:, 0], shown[:, 2]).max() < 1e-3
    assert (np.sort(few.scales, axis=1)[:, 0] < 0.002).all()  # and the sheet stays flat


def test_what_is_seen_more_stays_finer():
    x = np.linspace(-1, 1, 200)
    colors = np.random.default_rng(0).uniform(size=(200, 3))
    line = rounded(make_splats(np.stack([x, 0 * x, 0 * x], 1), 0.01, 0.9, colors))
    few = merge(line, 40, RESOLUTION, np.where(x < 0, 100.0, 1.0))
    assert (few.means[:, 0] < 0).sum() > 3 * (few.means[:, 0] > 0).sum()
