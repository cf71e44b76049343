"""Interleaved timing: the contestants take turns, so that a drift of the machine's speed hits all of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import numpy as np


def medians(
    contestants: dict[str, Callable[[], None]], rounds: int = 7, repeats: dict[str, int] | None = None
) -> dict[str, float]:
    """Median wall time of each in ms, kernels compiled and caches warm. ``repeats``: calls per round (default 5)."""
    for run in contestants.values():
        for _ in range(2):
            run()
    dr.sync_thread()
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, run in contestants.items():
            for _ in range((repeats or {}).get(name, 5)):
                start = time.perf_counter()
                run()
                dr.sync_thread()
                times[name].append(time.perf_counter() - start)
    return {name: float(np.median(values) * 1e3) for name, values in times.items()}


def unawaited(run: Callable[[], object], rounds: int = 5, calls: int = 10, warm_up: int = 6) -> float:
    """Median wall time of a call in ms where the next begins before the device is done, as steps of a training do."""
    for _ in range(warm_up):
        run()
    times = []
    for _ in range(rounds):
        dr.sync_thread()
        start = time.perf_counter()
        for _ in range(calls):
            run()
        dr.sync_thread()
        times.append((time.perf_counter() - start) / calls * 1e3)
    return float(np.median(times))


@dataclass
class Ratio:
    """Of the times of two contestants: median of the pairs, and where it lies in 95 of 100 cases."""

    a_ms: float
    b_ms: float
    median: float
    low: float
    high: float


def ratio(
    a: Callable[[], object], b: Callable[[], object], pairs: int = 300, clock: Callable[[], float] = time.perf_counter
) -> Ratio:
    """Time of ``a`` over that of ``b``, from pairs of calls in turns a b, b a: what a percent can be read from.

    ``clock``: ``time.process_time`` for the time of all processors, which other programs hardly change.

    The speed of a shared machine changes by tens of percents within a second, but hardly between two frames. The
    interval of the median is that of its order statistics, with a normal approximation of the binomial ones.
    """
    times = np.empty((pairs, 2))
    for k in range(-3, pairs):
        order = (a, b) if k % 2 else (b, a)
        for run in order:
            start = clock()
            run()
            dr.sync_thread()
            times[k, 0 if run is a else 1] = clock() - start
    ratios = np.sort(times[:, 0] / times[:, 1])
    spread = 0.98 * np.sqrt(pairs)
    low, high = (int(np.clip(pairs / 2 + sign * spread, 0, pairs - 1)) for sign in (-1, 1))
    a_ms, b_ms = (float(x) for x in np.median(times, 0) * 1e3)
    return Ratio(a_ms, b_ms, float(np.median(ratios)), float(ratios[low]), float(ratios[high]))
