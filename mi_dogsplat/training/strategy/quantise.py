"""The last part of a training sees the model as its file will have it, so that the file loses nothing that matters.

Rendered are the numbers of the file (``quantisation/straight_through.py``), and at the end they become the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...formats.grids import Steps
from ..events import Event, Quantised
from ..quantisation.quantiser import Coding, Quantiser
from ..quantisation.room import Room
from .strategy import Strategy, Training

SHARE = 0.2  # of the run


@dataclass(frozen=True)
class Quantisation(Strategy[Coding]):
    """Straight-through quantisation for a format of ``formats/coded.py``."""

    format: str
    steps: Steps | None = None  # those of ``formats/coded.STEPS``
    room: Room | None = None  # of a file whose size is given

    @property
    def quantiser(self) -> Quantiser:
        """That does it."""
        return Quantiser(self.format, self.steps, self.room)

    def new_state(self, t: Training) -> Coding:
        return Coding()

    def before_step(self, t: Training, state: Coding) -> None:
        of = max(1, round(SHARE * t.steps))
        step = t.step_count - (t.steps - of)
        if step >= 0:
            self.quantiser.before_step(state, t.optimizer, t.photographs.cameras, t.options, step, of)

    def params(self, t: Training, state: Coding, params: dict) -> dict:
        return self.quantiser.params(state, params, t.optimizer.bands)

    def rearranged(self, state: Coding, index: np.ndarray, fresh: np.ndarray) -> None:
        state.rearrange(index)

    def after_step(self, t: Training, state: Coding) -> list[Event]:
        if t.step_count < t.steps or state.palette is None:
            return []
        self.quantiser.settle(state, t.optimizer)
        return [Quantised(self.format, len(state.entries))]
