"""Round numbers along an axis, and numbers as short as an axis has room for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

DIGITS, MOST_DIGITS = 4, 12  # of a label, where they tell it from its neighbours, and where they do not
ROUNDED = 0.01  # of the distance to its neighbour, that a label may be off


def nice_ticks(low: float, high: float, count: int) -> list[float]:
    """About ``count`` round values (1, 2 or 5 times a power of ten apart) within low..high."""
    raw = (high - low) / max(count, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """1, 2 and 5 times powers of ten; powers alone over many decades; `nice_ticks` if too few."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for multiples in ((1, 2, 5), (1,)):
        ticks = [m * 10.0**d for d in decades for m in multiples if low <= m * 10.0**d <= high]
        if len(ticks) <= 7:
            break
    return ticks if len(ticks) >= 3 else nice_ticks(low, high, 5)


def numbers(values: Sequence[float]) -> list[str]:
    """Tick labels of one axis, each as ``number`` with as many digits as its neighbours leave necessary."""
    step = min((b - a for a, b in pairwise(values)), default=0.0)
    digits = DIGITS
    while step and digits < MOST_DIGITS and any(abs(float(f"{v:.{digits}g}") - v) > ROUNDED * step for v in values):
        digits += 1
    return [number(value, digits) for value in values]


def number(value: float, digits: int = DIGITS) -> str:
    """A tick label: ``20k``, ``1.5M``, ``3e9``, ``2e-7``, else up to so many digits; with a true minus sign."""
    if abs(value) >= 1e9:
        return f"{value:.{digits}g}".replace("e+0", "e").replace("e+", "e").replace("-", "\u2212")
    for scale, unit in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= scale:
            return f"{value / scale:.{digits}g}{unit}".replace("-", "\u2212")
    return f"{value:.{digits}g}".replace("e-0", "e-").replace("-", "\u2212") if abs(value) > 1e-12 else "0"
