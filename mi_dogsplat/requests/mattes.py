"""How much of a pixel each object covers, as Cryptomatte stores it: the first few by their coverage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

NOTHING = -1  # no object
RANKS = 4  # objects of a pixel that are kept


def ranked(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """[H, W, RANKS, 2] of number and coverage, the largest first; where there are fewer, ``NOTHING`` and 0.

    parts: numbers of objects and the weights, [H, W], that they add; one object may be there several times.
    """
    numbers = np.stack([number for number, _ in parts]).astype(np.int64)  # [P, H, W]
    weights = np.stack([np.where(number == NOTHING, 0, weight) for number, weight in parts])
    order = np.argsort(numbers, axis=0, kind="stable")
    numbers, sums = np.take_along_axis(numbers, order, 0), np.cumsum(np.take_along_axis(weights, order, 0), 0)
    is_last = np.concatenate([numbers[1:] != numbers[:-1], np.ones_like(numbers[:1], bool)])
    until = np.maximum.accumulate(np.where(is_last, sums, 0), 0)  # of the objects that are complete
    before = np.concatenate([np.zeros_like(until[:1]), until[:-1]])
    coverage = np.where(is_last, sums - before, 0)
    best = np.argsort(-coverage, axis=0, kind="stable")[:RANKS]
    found = np.zeros((*numbers.shape[1:], RANKS, 2), np.float32)
    found[..., 0] = NOTHING
    for rank, row in enumerate(best):
        share = np.take_along_axis(coverage, row[None], 0)[0]
        found[..., rank, 0] = np.where(share > 0, np.take_along_axis(numbers, row[None], 0)[0], NOTHING)
        found[..., rank, 1] = share
    return found
