"""Which of its options each primitive gets, under one budget: what gains most for its bytes.

Every primitive has options, each with a value and a price in bytes; the first is to be removed, worth 0 for 0 bytes.
One option each is wanted whose values add up to most while the bytes stay within the budget: a multiple-choice
knapsack. For a price λ of a byte each primitive by itself takes the option with the largest value - λ bytes (Lagrange
relaxation; Everett 1963), which is a corner of the upper hull of its options. Between two such corners lies an
*increment*, a gain per byte; a fall of λ buys increments in the order of their gains per byte, which is the greedy
algorithm on the hulls. The largest total that fits is found by bisection. What is bought is the best choice of all
that take no more bytes, and it misses the best within the budget by less than the first increment that did not fit.
"""

from __future__ import annotations

import numpy as np


def allocate(values: np.ndarray, prices: np.ndarray, budget: float) -> np.ndarray:
    """Option of each primitive, [N] int; prices of what is chosen add up to ``budget`` at most.

    Args:
        values: [N, options], 0 for the first; what is not a number or -inf is never chosen.
        prices: [options] or [N, options] bytes, 0 for the first and positive for the others.

    Raises ``ValueError`` for a negative budget, or options that do not begin with nothing for nothing.
    """
    prices = np.broadcast_to(np.asarray(prices, np.float64), np.shape(values))
    values = np.where(np.isnan(values), -np.inf, values).astype(np.float64)
    if not budget >= 0:
        raise ValueError(f"allocate: the budget is {budget}, expected at least 0")
    if values.ndim != 2 or np.any(values[:, :1] != 0) or np.any(prices[:, :1] != 0) or np.any(prices[:, 1:] <= 0):
        raise ValueError("allocate: the first option is worth 0 for 0 bytes, all others have a positive price")
    n = len(values)
    everyone = np.arange(n)

    def chosen(byte_price: float) -> np.ndarray:
        """Of equally good options the cheapest."""
        net = values - byte_price * prices
        best = net >= net.max(axis=1, keepdims=True)
        return np.where(best, prices, np.inf).argmin(axis=1)

    def bytes_of(choice: np.ndarray) -> float:
        return float(prices[everyone, choice].sum())

    most = chosen(0.0)
    if n == 0 or bytes_of(most) <= budget:
        return most
    ratios = values[:, 1:] / prices[:, 1:]

    def price_of(bits: int) -> float:
        """The bits of positive floats are in their order: bisection ends at two neighbours."""
        return float(np.array(bits).view(np.float64))

    low, high = 0, int(np.array(ratios.max(initial=0), np.float64).view(np.int64)) + 1
    while high - low > 1:
        middle = (low + high) // 2
        if bytes_of(chosen(price_of(middle))) <= budget:
            high = middle
        else:
            low = middle
    choice, more = chosen(price_of(high)), chosen(price_of(low))
    # increments of one gain per byte, which do not all fit: as many as do
    tied = np.flatnonzero(choice != more)
    added = prices[tied, more[tied]] - prices[tied, choice[tied]]
    order = np.argsort(added, kind="stable")
    bought = tied[order[bytes_of(choice) + np.cumsum(added[order]) <= budget]]
    choice[bought] = more[bought]
    return choice
