"""Interleaved timing: the contestants take turns, so that a drift of the machine's speed hits all of them."""

from __future__ import annotations

import time
from collections.abc import Callable

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
