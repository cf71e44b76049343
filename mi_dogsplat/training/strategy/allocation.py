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

from dataclasses import dataclass

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
    options = _Options(values, prices)
    most = options.chosen(0.0)
    if len(most) == 0 or options.bytes_of(most) <= budget:
        return most
    too_low, enough = options.prices_around(budget)
    return options.filled_up(options.chosen(enough), options.chosen(too_low), budget)


@dataclass(frozen=True)
class _Options:
    values: np.ndarray  # [N, options]
    prices: np.ndarray  # the same, bytes

    def chosen(self, byte_price: float) -> np.ndarray:
        """[N] what each primitive takes at a price λ of a byte; of equally good options the cheapest."""
        net = self.values - byte_price * self.prices
        best = net >= net.max(axis=1, keepdims=True)
        return np.where(best, self.prices, np.inf).argmin(axis=1)

    def price_of(self, choice: np.ndarray) -> np.ndarray:
        """[N] bytes."""
        return self.prices[np.arange(len(choice)), choice]

    def bytes_of(self, choice: np.ndarray) -> float:
        return float(self.price_of(choice).sum())

    def prices_around(self, budget: float) -> tuple[float, float]:
        """(the highest price of a byte at which the choice takes more than the budget, the lowest at which it fits).

        The bits of positive floats are in their order: bisection ends at two neighbours.
        """
        ratios = self.values[:, 1:] / self.prices[:, 1:]
        low, high = 0, int(np.array(ratios.max(initial=0), np.float64).view(np.int64)) + 1
        while high - low > 1:
            middle = (low + high) // 2
            if self.bytes_of(self.chosen(_float_of(middle))) <= budget:
                high = middle
            else:
                low = middle
        return _float_of(low), _float_of(high)

    def filled_up(self, choice: np.ndarray, more: np.ndarray, budget: float) -> np.ndarray:
        """``choice`` with as much of ``more`` as fits, where increments of one gain per byte do not all fit."""
        tied = np.flatnonzero(choice != more)
        added = self.price_of(more)[tied] - self.price_of(choice)[tied]
        order = np.argsort(added, kind="stable")
        bought = tied[order[self.bytes_of(choice) + np.cumsum(added[order]) <= budget]]
        choice = choice.copy()
        choice[bought] = more[bought]
        return choice


def _float_of(bits: int) -> float:
    return float(np.array(bits).view(np.float64))
