"""What happens to the primitives of a training, as typed records: in ``history.jsonl``, in reports, for strategies.

A row of the history has them twice: ``event`` is the text for people, ``events`` the records for programs, objects with
their ``kind`` and their numbers. A strategy of your own may bring records of its own: a subclass of ``Event``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar


@dataclass(frozen=True)
class Event:
    """One thing that happened. Subclasses name their ``kind`` and say in ``text`` what it is."""

    kind: ClassVar[str]

    @property
    def text(self) -> str:
        """For people."""
        raise NotImplementedError

    def columns(self) -> dict[str, Any]:
        """Fields of the row of the history beside the text and the record."""
        return {}

    def record(self) -> dict[str, Any]:
        """The object that stands in ``events``."""
        return {"kind": self.kind, **dataclasses.asdict(self)}


@dataclass(frozen=True)
class Dropped(Event):
    """Primitives that left without being pruned; ``what`` they were."""

    kind = "dropped"
    count: int
    what: str

    @property
    def text(self) -> str:
        return f"dropped {self.count} {self.what}"


@dataclass(frozen=True)
class Densified(Event):
    """A refinement of the density."""

    kind = "densified"
    cloned: int
    split: int
    removed: int

    @property
    def text(self) -> str:
        return f"densify cloned={self.cloned} split={self.split} removed={self.removed}"


@dataclass(frozen=True)
class MemoryFull(Event):
    """The cap that the memory of a run has set on its primitives; ``memory`` in words."""

    kind = "memory_full"
    most: int
    memory: str

    @property
    def text(self) -> str:
        return f"memory: no more than {self.most} primitives fit into {self.memory}"


@dataclass(frozen=True)
class OpacityReset(Event):
    """All opacities were lowered."""

    kind = "opacity_reset"

    @property
    def text(self) -> str:
        return "reset opacity"


@dataclass(frozen=True)
class ShDegree(Event):
    """One more degree of view-dependent colour."""

    kind = "sh_degree"
    degree: int

    @property
    def text(self) -> str:
        return f"sh degree {self.degree}"


@dataclass(frozen=True)
class NotPruned(Event):
    """There is nothing to prune."""

    kind = "not_pruned"
    reason: str

    @property
    def text(self) -> str:
        return f"no pruning: {self.reason}"


@dataclass(frozen=True)
class Refined(Event):
    """A check of the pruning that lets the model go on refining; ``train_l1`` is the mean over the training views."""

    kind = "refined"
    reason: str
    train_l1: float

    @property
    def text(self) -> str:
        return f"refine: {self.reason}"

    def columns(self) -> dict[str, Any]:
        return {"train_l1": self.train_l1}


@dataclass(frozen=True)
class Pruned(Event):
    """A check of the pruning that pruned: numbers of primitives ``before`` and ``after``."""

    kind = "pruned"
    before: int
    after: int
    reason: str
    train_l1: float

    @property
    def text(self) -> str:
        return f"prune {self.before} -> {self.after}: {self.reason}"

    def columns(self) -> dict[str, Any]:
        return {"train_l1": self.train_l1, "pruned_from": self.before, "pruned_to": self.after}


@dataclass(frozen=True)
class DogActivated(Event):
    """All ``count`` primitives became DoG; ``psnr_before``: mean over the test views before, None without any."""

    kind = "dog_activated"
    count: int
    psnr_before: float | None = None

    @property
    def text(self) -> str:
        return f"dog activated {self.count} primitives"

    def columns(self) -> dict[str, Any]:
        return {} if self.psnr_before is None else {"psnr_before": self.psnr_before}


def row_of(events: Sequence[Event]) -> dict[str, Any]:
    """Fields of a row of the history: ``event``, ``events`` and their columns; none where nothing happened."""
    if not events:
        return {}
    columns = {name: value for event in events for name, value in event.columns().items()}
    return columns | {"event": "; ".join(e.text for e in events), "events": [e.record() for e in events]}
