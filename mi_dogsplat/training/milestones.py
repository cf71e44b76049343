"""Steps of a schedule that is written for one length and run at another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

R = TypeVar("R", bound="FromStep")


def scaled_milestone(step: int, factor: float) -> int:
    """A step of a schedule of another length; what is not at the start stays at least one step from it."""
    return max(min(1, step), round(step * factor))


@dataclass(frozen=True)
class FromStep:
    """A rule that holds from a step on, or at it."""

    start: int

    def scaled(self: R, factor: float) -> R:
        """The rule of a run ``factor`` times as long."""
        return replace(self, start=scaled_milestone(self.start, factor))

    def earlier(self: R, steps: int) -> R:
        """The rule of a run that begins ``steps`` steps later."""
        return replace(self, start=max(0, self.start - steps))
