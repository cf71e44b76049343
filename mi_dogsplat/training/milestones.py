"""Steps of a schedule that is written for one length and run at another."""

from __future__ import annotations


def scaled_milestone(step: int, factor: float) -> int:
    """A step of a schedule of another length; what is not at the start stays at least one step from it."""
    return max(min(1, step), round(step * factor))
