"""Coverages of objects, ranked."""

import numpy as np
from mi_dogsplat.requests.mattes import NOTHING, RANKS, ranked


def brute_force(numbers, weights):
    """[(number, coverage)] of one pixel, the largest first."""
    total = {}
    for number, weight in zip(numbers, weights, strict=True):
        if number != NOTHING:
            total[number] = total.get(number, 0) + weight
    found = sorted(((n, w) for n, w in total.items() if w > 0), key=lambda pair: (-pair[1], pair[0]))[:RANKS]
    return found + [(NOTHING, 0)] * (RANKS - len(found))


def test_objects_are_summed_and_ranked():
    rng = np.random.default_rng(0)
    parts = [(rng.integers(-1, 6, (4, 5)), rng.integers(0, 5, (4, 5)) / 8) for _ in range(7)]
    found = ranked(parts)
    for y, x in np.ndindex(4, 5):
        expected = brute_force([n[y, x] for n, _ in parts], [w[y, x] for _, w in parts])
        np.testing.assert_array_equal(found[y, x, :, 1], [w for _, w in expected])
        known = dict(expected)  # of equal coverages any may be first
        assert all(known.get(n, w) == w for n, w in found[y, x] if n != NOTHING)


def test_one_part_is_the_object_itself():
    found = ranked([(np.array([[3, NOTHING]]), np.array([[0.25, 1.0]]))])
    np.testing.assert_array_equal(found[0, 0, 0], [3, 0.25])
    np.testing.assert_array_equal(found[0, 1], [[NOTHING, 0]] * len(found[0, 1]))
