"""Rows that all primitives get at a step of the run, and that leave them at its end where no pixel shows them.

They begin at zero, or next to it, so that the pictures stay what they are. They come when pruning is over: few
primitives, each of which stands for what several have shown before, gain most by them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...scene.row_groups import NAMED, RowGroup
from ..events import ROWS_ACTIVATED, ROWS_LEFT_OUT, Event
from ..milestones import FromStep
from ..optimizer.splat_optimizer import SplatOptimizer
from .once import Once
from .strategy import Strategy, Training


@dataclass(frozen=True)
class RowRule(FromStep):
    """Numbers of the recipe, for a run of 30,000 steps.

    Raises ``ValueError`` for a number out of range.
    """

    least_of: ClassVar[str]  # what ``least`` is a change of

    start: int = 25_000  # step at which all primitives get rows
    least: float = 1 / 255  # rows that change less are left out at the end

    def __post_init__(self) -> None:
        if self.start < 0:
            raise ValueError(f"{type(self).__name__}: start is {self.start}, expected a step")
        if not 0 <= self.least < np.inf:
            raise ValueError(f"{type(self).__name__}: least is {self.least}, expected a change of {self.least_of}")


def give_rows(optimizer: SplatOptimizer, group: RowGroup, begun: Mapping[str, np.ndarray] | None = None) -> int:
    """Give rows to every primitive, and return how many there are; those that have some keep them.

    Args:
        begun: [N, …] of each array of the group, what the others begin with; None: zeros.
    """
    index = optimizer.index_of(group)
    zeros = {name: np.zeros((optimizer.n, *shape), np.float32) for name, shape in group.arrays.items()}
    values = zeros | dict(begun or {})
    for name, shape in group.arrays.items():
        if len(index):
            values[name][index] = optimizer.numpy(name).reshape(-1, *shape)
    optimizer.set_rows(group, np.arange(optimizer.n), values)
    return optimizer.n


@dataclass(frozen=True)
class GivenRows:
    """A kind of rows, and what is special about its coming and going.

    ``shown``: [M] whether a pixel may show each row that there is, which is one at least.
    ``begun``: [N, …] of each array, what the rows begin with; None: zeros.
    """

    name: str  # in ``NAMED``, and of the field of ``Recipe`` that is its rule
    shown: Callable[[RowRule, SplatOptimizer, RowGroup], np.ndarray]
    begun: Callable[[Training], Mapping[str, np.ndarray]] | None = None

    @property
    def group(self) -> RowGroup:
        return NAMED[self.name]

    @property
    def word(self) -> str:
        """Of one row, as the states of strategies are named in checkpoints."""
        return self.name.replace("_", "").removesuffix("s")


@dataclass(frozen=True)
class RowControl(Strategy[None]):
    """At the end of the run, rows that no pixel shows are left out, before anybody looks at the size of the file."""

    given: GivenRows
    rule: RowRule

    @property
    def name(self) -> str:
        return f"{self.given.word}control"

    def end(self, t: Training, state: None) -> list[Event]:
        group = self.given.group
        index = t.optimizer.index_of(group)
        shown = self.given.shown(self.rule, t.optimizer, group) if len(index) else np.zeros(0, bool)
        if shown.all():
            return []
        rows = {name: t.optimizer.numpy(name)[shown].reshape(-1, *shape) for name, shape in group.arrays.items()}
        t.optimizer.set_rows(group, index[shown], rows)
        left = int(shown.sum())
        return [ROWS_LEFT_OUT[self.given.name](len(index) - left, left)]


@dataclass(frozen=True)
class RowActivation(Once):
    """``give_rows`` at the step of the rule."""

    given: GivenRows
    rule: RowRule

    @property
    def name(self) -> str:
        return f"{self.given.word}activation"

    @property
    def start(self) -> int:
        return self.rule.start

    def act(self, t: Training) -> list[Event]:
        begun = self.given.begun and self.given.begun(t)
        return [ROWS_ACTIVATED[self.given.name](give_rows(t.optimizer, self.given.group, begun))]
