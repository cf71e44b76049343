"""Relocation: what copies of a primitive cover together, by quadrature, and whose rows and moments change."""

import numpy as np
import pytest
from mi_dogsplat.compare.rivals.relocation import MAX_COPIES, draw, duplicate, relocate, shared
from mi_dogsplat.training.optimizer.adam import Entry
from stepped_optimizers import optimizer_of

OPACITIES = [0.005, 0.1, 0.5, 0.9, 0.999]


@pytest.mark.parametrize("count", [1, 2, 3, 10, MAX_COPIES])
def test_copies_cover_as_much_as_the_one_did_at_its_centre_and_along_a_line(count):
    x = np.linspace(-12, 12, 100_001)
    each, factor = shared(np.array(OPACITIES), np.full(len(OPACITIES), count))
    for o, o_new, f in zip(OPACITIES, each, factor, strict=True):
        left = np.ones_like(x)  # what blending one copy after another lets through
        for _ in range(count):
            left *= 1 - o_new * np.exp(-0.5 * (x / f) ** 2)
        assert left[50_000] == pytest.approx(1 - o, rel=1e-9)
        assert np.sum(1 - left) * (x[1] - x[0]) == pytest.approx(o * np.sqrt(2 * np.pi), rel=1e-9)


def test_more_copies_than_the_limit_are_shared_as_so_many_and_full_opacity_stays_finite():
    opacity, count = np.array([0.3, 1.0]), np.array([MAX_COPIES, 3])
    many = shared(opacity, np.array([9 * MAX_COPIES, 3]))
    assert all(np.array_equal(a, b) and np.isfinite(a).all() for a, b in zip(shared(opacity, count), many, strict=True))


def opacities_of(optimizer) -> np.ndarray:
    return 1 / (1 + np.exp(-optimizer.numpy("logit_opacities").astype(float)))


def test_dead_primitives_become_copies_and_share_with_their_sources_and_the_others_keep_everything():
    optimizer = optimizer_of([0.1] * 6, [0.8, 0.001, 0.5, 0.002, 0.003, 0.7])
    before = {name: optimizer.numpy(name) for name in optimizer.adam}
    m_before = Entry.of(optimizer.adam, "means").m.numpy().reshape(-1, 3)
    relocate(optimizer, np.array([1, 3, 4]), np.array([0, 0, 5]), 0.005)
    after = {name: optimizer.numpy(name) for name in optimizer.adam}
    source = np.array([0, 0, 2, 0, 5, 5])
    for name in ("means", "quats", "sh_dc", "sh_rest"):
        np.testing.assert_array_equal(after[name], before[name][source])
    left = (1 - opacities_of(optimizer)).astype(float)
    assert left[0] * left[1] * left[3] == pytest.approx(0.2, rel=1e-5)
    assert left[4] * left[5] == pytest.approx(0.3, rel=1e-5) and left[2] == pytest.approx(0.5)
    shrunk = after["log_scales"] - before["log_scales"][source]
    assert (shrunk[[0, 1, 3, 4, 5]] < -0.05).all() and not shrunk[2].any()
    np.testing.assert_allclose(np.ptp(shrunk, axis=1), 0, atol=1e-6)  # one factor for the three axes
    m = Entry.of(optimizer.adam, "means").m.numpy().reshape(-1, 3)
    assert not m[[0, 1, 3, 4, 5]].any() and np.array_equal(m[2], m_before[2])


def test_duplicates_are_appended_with_moments_of_zero_and_none_is_fainter_than_the_least_opacity():
    optimizer = optimizer_of([0.1] * 3, [0.8, 0.006, 0.5])
    before = optimizer.numpy("means")
    duplicate(optimizer, np.array([1, 2, 1]), 0.005)
    np.testing.assert_array_equal(optimizer.numpy("means"), before[[0, 1, 2, 1, 2, 1]])
    opacity = opacities_of(optimizer)
    np.testing.assert_allclose(opacity[[1, 3, 5]], 0.005, rtol=1e-5)
    np.testing.assert_allclose((1 - opacity[[2, 4]]) ** 2, 0.5, rtol=1e-5)
    assert opacity[0] == pytest.approx(0.8)
    m = Entry.of(optimizer.adam, "means").m.numpy().reshape(-1, 3)
    assert m[0].all() and not m[1:].any()
    duplicate(optimizer, np.zeros(0, int), 0.005)
    assert optimizer.n == 6


def test_sources_are_drawn_in_proportion_to_their_weights():
    drawn = draw(np.array([0.0, 1.0, 3.0]), 40_000, np.random.default_rng(0))
    np.testing.assert_allclose(np.bincount(drawn) / 40_000, [0, 0.25, 0.75], atol=0.007)  # 3 standard deviations
