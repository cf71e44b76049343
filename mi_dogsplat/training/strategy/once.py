"""What happens once in a training: at a step, or as soon after it as there is a step."""

from __future__ import annotations

from dataclasses import dataclass

from ..events import Event
from .strategy import Strategy, Training


@dataclass
class Done:
    """State of ``Once``."""

    done: bool = False


@dataclass(frozen=True)
class Once(Strategy[Done]):
    """``act`` after the step ``start``; of a run that begins later, before its first step."""

    @property
    def start(self) -> int:
        raise NotImplementedError

    def act(self, t: Training) -> list[Event]:
        """What happens, and the record of it."""
        raise NotImplementedError

    def new_state(self, t: Training) -> Done:
        return Done()

    def begin(self, t: Training, state: Done) -> list[Event]:
        return self.after_step(t, state)

    def after_step(self, t: Training, state: Done) -> list[Event]:
        if state.done or t.step_count < self.start:
            return []
        state.done = True
        return self.act(t)
