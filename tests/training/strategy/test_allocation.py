"""The allocation under a budget against all choices there are."""

import itertools

import numpy as np
import pytest
from mi_dogsplat.training.strategy.allocation import allocate


def tiny(seed: int):
    """Values [N, 4] and prices [4] of a few primitives; some options are of no use."""
    rng = np.random.default_rng(seed)
    n = 6
    prices = np.concatenate([[0], np.sort(rng.uniform(1, 20, 3))])
    values = np.concatenate([np.zeros((n, 1)), rng.uniform(-1, 5, (n, 3)) * rng.uniform(0, 3, (n, 1))], axis=1)
    return values, prices


def choices(values, prices) -> tuple[np.ndarray, np.ndarray]:
    """(value, bytes) of every choice there is."""
    n, options = values.shape
    each = np.array(list(itertools.product(range(options), repeat=n)))
    return values[np.arange(n), each].sum(1), np.broadcast_to(prices, values.shape)[np.arange(n), each].sum(1)


def outcome(values, prices, budget) -> tuple[float, float, np.ndarray]:
    choice = allocate(values, prices, budget)
    rows = np.arange(len(values))
    return values[rows, choice].sum(), np.broadcast_to(prices, values.shape)[rows, choice].sum(), choice


@pytest.mark.parametrize("seed", range(20))
def test_nothing_of_as_few_bytes_is_worth_more_and_little_within_the_budget(seed):
    values, prices = tiny(seed)
    all_values, all_bytes = choices(values, prices)
    largest = values.max()  # no increment is worth more
    for share in (0, 0.05, 0.2, 0.5, 0.8, 1.0):
        budget = share * all_bytes.max()
        value, size, _ = outcome(values, prices, budget)
        assert size <= budget
        assert value >= all_values[all_bytes <= size + 1e-9].max() - 1e-9
        assert value >= all_values[all_bytes <= budget].max() - largest


@pytest.mark.parametrize("seed", range(5))
def test_prices_may_be_those_of_each_primitive(seed):
    values, prices = tiny(seed)
    prices = prices * np.random.default_rng(seed).uniform(0.5, 2, (len(values), 1))
    all_values, all_bytes = choices(values, prices)
    budget = 0.4 * all_bytes.max()
    value, size, _ = outcome(values, prices, budget)
    assert size <= budget and value >= all_values[all_bytes <= size + 1e-9].max() - 1e-9


def test_with_room_for_all_each_takes_the_best_and_what_is_worth_nothing_goes():
    values = np.array([[0, 1, 3, 2], [0, 0, 0, 0], [0, -1, -2, -3], [0, 1, 1, 1.0]])
    np.testing.assert_array_equal(allocate(values, np.array([0, 1, 2, 3]), 1e9), [2, 0, 0, 1])


def test_as_many_of_equals_as_fit_and_a_budget_of_nothing_leaves_nothing():
    values = np.tile([0.0, 2.0], (10, 1))
    assert allocate(values, np.array([0, 3]), 17).sum() == 5
    assert not allocate(values, np.array([0, 3]), 0).any()
    assert allocate(np.zeros((0, 3)), np.array([0, 1, 2]), 5).shape == (0,)


def test_what_has_no_value_is_never_chosen():
    values = np.array([[0, np.nan, 1], [0, np.nan, np.nan], [0, 5, -np.inf]])
    np.testing.assert_array_equal(allocate(values, np.array([0, 1, 2]), 100), [2, 0, 1])


def test_options_that_do_not_begin_with_nothing_are_refused():
    with pytest.raises(ValueError, match="first option"):
        allocate(np.ones((2, 2)), np.array([0, 1]), 1)
    with pytest.raises(ValueError, match="positive price"):
        allocate(np.array([[0, 1.0]]), np.array([0, 0]), 1)
    with pytest.raises(ValueError, match="budget is -1"):
        allocate(np.zeros((1, 2)), np.array([0, 1]), -1)
