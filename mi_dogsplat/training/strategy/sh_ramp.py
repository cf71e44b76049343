"""View-dependent colour comes in degree by degree (Kerbl et al. 2023, Sec. 7.1): first what all views agree on."""

from __future__ import annotations

from dataclasses import dataclass

from ..events import Event, ShDegree
from .strategy import Strategy, Training


@dataclass(frozen=True)
class ShRamp(Strategy[None]):
    """One more degree every so many steps; the history tells when."""

    every: int  # steps; 0: all degrees from the start

    def degree(self, step: int, highest: int) -> int:
        """The degree that is rendered after ``step`` steps."""
        return min(highest, step // self.every) if self.every else highest

    def after_step(self, t: Training, state: None) -> list[Event]:
        degree = t.options.sh_degree
        return [ShDegree(degree)] if degree and t.step_count == degree * self.every else []
