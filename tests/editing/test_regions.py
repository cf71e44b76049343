"""Crops and connected parts, against loops over all primitives."""

import numpy as np
import pytest
from mi_dogsplat.editing.moments import Clusters
from mi_dogsplat.editing.regions import DEVIATIONS, NEIGHBOURS, deviations_along, in_box, in_sphere, largest_parts
from mi_dogsplat.scene.splats import Splats
from splat_scenes import make_splats, random_splats, rounded


def scattered(n=NEIGHBOURS, seed=0) -> Splats:
    """Few enough that everyone is among the nearest of all."""
    splats = rounded(random_splats(n, seed=seed, degree=0, dog_share=0))
    splats.log_scales -= 1.2
    return splats


def test_a_box_and_a_sphere_keep_the_centres_within_and_on_them():
    splats = rounded(make_splats([[0, 0, 0], [1, 0, 0], [1.001, 0, 0], [0, -2, 0], [0.5, 0.5, 0.5]]))
    assert in_box(splats, (0, -1, 0), (1, 1, 1)).tolist() == [True, True, False, False, True]
    assert in_box(splats, (1, 0, 0), (1, 0, 0)).tolist() == [False, True, False, False, False]
    assert in_sphere(splats, (0, 0, 0), 1.0).tolist() == [True, True, False, False, True]
    assert in_sphere(splats, (0, -2, 0), 0.1).tolist() == [False, False, False, True, False]
    assert in_sphere(splats, (0, 0, 0), 1e200).all() and not in_sphere(splats, (1e200, 0, 0), 1.0).any()


def test_the_deviation_along_a_direction_is_that_of_the_covariance():
    splats = scattered()
    directions = np.random.default_rng(1).normal(size=(splats.n_splats, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    covariances = Clusters.of(splats).covariances
    expected = np.sqrt(np.einsum("ni,nij,nj->n", directions, covariances, directions))
    assert deviations_along(splats, np.arange(splats.n_splats), directions) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("count", [1, 2])
def test_the_largest_parts_are_those_of_a_search_over_all_pairs(seed, count):
    splats = scattered(seed=seed)
    n, covariances = splats.n_splats, Clusters.of(splats).covariances
    part = list(range(n))
    for i in range(n):
        for j in range(i):
            offset = (splats.means[j] - splats.means[i]).astype(float)
            distance = np.linalg.norm(offset)
            reach = sum(np.sqrt(offset @ covariances[k] @ offset) / distance for k in (i, j))
            if distance <= DEVIATIONS * reach:
                old, new = part[i], part[j]
                part = [new if p == old else p for p in part]
    names = sorted(set(part), key=lambda p: (-part.count(p), part.index(p)))
    assert len(names) > 2
    assert largest_parts(splats, count).tolist() == [p in names[:count] for p in part]


def test_one_or_no_primitive_hangs_together():
    assert largest_parts(Splats.empty(0), 1).shape == (0,)
    assert largest_parts(scattered(1), 1).tolist() == [True]


def test_two_at_one_place_touch():
    splats = rounded(make_splats([[0, 0, 0], [0, 0, 0], [9, 9, 9]], 0.1))
    assert largest_parts(splats, 1).tolist() == [True, True, False]


@pytest.mark.parametrize("log_scale", [90, 1e4, 3e38])
def test_one_that_is_larger_than_float32_can_say_touches_all(log_scale):
    splats = rounded(make_splats([[0, 0, 0], [30, 0, 0], [60, 0, 0]], 0.1))
    splats.log_scales[0] = log_scale
    assert largest_parts(splats, 1).all()
