"""Targets at which methods are compared: equal counts of primitives, so no size of a file."""

from __future__ import annotations

from ..support.errors import DataError
from ..training.target import checked_target

COUNTS = "a ratio (0.1, 10%) or a count of primitives (20000)"


def counted_target(flag: str, target: float | str) -> float:
    """A ratio or a count as a number. Raises ``DataError``, which names the flag, for all else."""
    try:
        counted = checked_target(target)
    except ValueError as error:
        raise DataError(flag, str(error), f"use {COUNTS}") from None
    if isinstance(counted, str):
        raise DataError(flag, f"{target} is the size of a file", f"use {COUNTS}")
    return counted
