"""What happens to the primitives of a training, as typed records: in ``history.jsonl``, in reports, for strategies.

A row of the history has them twice: ``event`` is the text for people, ``events`` the records for programs, objects with
their ``kind`` and their numbers. A strategy of your own may bring records of its own: a subclass of ``Event``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

from ..scene.row_groups import NAMED


@dataclass(frozen=True)
class Event:
    """One thing that happened; subclasses have the numbers, and three facts about them."""

    kind: ClassVar[str]
    words: ClassVar[str]  # for people, with the numbers by their names in braces
    columns: ClassVar[Mapping[str, str]] = MappingProxyType({})  # of the row of the history, and the number in each

    @property
    def text(self) -> str:
        """For people."""
        return self.words.format_map(vars(self))

    @property
    def record(self) -> dict[str, Any]:
        """For programs."""
        return {"kind": self.kind, **dataclasses.asdict(self)}


def row_of(events: Sequence[Event]) -> dict[str, Any]:
    """Fields of a row of the history: ``event``, ``events`` and their columns; none where nothing happened."""
    if not events:
        return {}
    columns = {column: getattr(event, name) for event in events for column, name in event.columns.items()}
    row: dict[str, Any] = {column: number for column, number in columns.items() if number is not None}
    return row | {"event": "; ".join(event.text for event in events), "events": [event.record for event in events]}


@dataclass(frozen=True)
class Dropped(Event):
    """Primitives that left without being pruned; ``what`` they were."""

    kind, words = "dropped", "dropped {count} {what}"
    count: int
    what: str


@dataclass(frozen=True)
class Densified(Event):
    """A refinement of the density."""

    kind, words = "densified", "densify cloned={cloned} split={split} removed={removed}"
    cloned: int
    split: int
    removed: int


@dataclass(frozen=True)
class MemoryFull(Event):
    """The cap that the memory of a run has set on its primitives; ``memory`` in words."""

    kind, words = "memory_full", "memory: no more than {most} primitives fit into {memory}"
    most: int
    memory: str


@dataclass(frozen=True)
class OpacityReset(Event):
    """All opacities were lowered."""

    kind, words = "opacity_reset", "reset opacity"


@dataclass(frozen=True)
class ShDegree(Event):
    """One more degree of view-dependent colour."""

    kind, words = "sh_degree", "sh degree {degree}"
    degree: int


@dataclass(frozen=True)
class NotPruned(Event):
    """There is nothing to prune."""

    kind, words = "not_pruned", "no pruning: {reason}"
    reason: str


@dataclass(frozen=True)
class Refined(Event):
    """A check of the pruning that lets the model go on refining.

    ``train_l1``: mean over the training views, None where it decides nothing.
    """

    kind, words = "refined", "refine: {reason}"
    columns = MappingProxyType({"train_l1": "train_l1"})
    reason: str
    train_l1: float | None = None


@dataclass(frozen=True)
class Pruned(Event):
    """A check of the pruning that pruned: numbers of primitives ``before`` and ``after``.

    ``train_l1``: mean over the training views before, None where it decides nothing.
    """

    kind, words = "pruned", "prune {before} -> {after}: {reason}"
    columns = MappingProxyType({"train_l1": "train_l1", "pruned_from": "before", "pruned_to": "after"})
    before: int
    after: int
    reason: str
    train_l1: float | None = None


@dataclass(frozen=True)
class Allocated(Event):
    """The bytes of the file were divided anew: it has ``bytes`` of the ``budget``.

    ``degrees``: how many have SH degree 0, 1, 2, 3; ``dog``: how many are DoG.
    """

    kind, words = "allocated", "{bytes} of {budget} bytes: SH degrees {degrees}, {dog} DoG"
    columns = MappingProxyType({"file_bytes": "bytes"})
    bytes: int
    budget: int
    degrees: tuple[int, ...]
    dog: int


@dataclass(frozen=True)
class DogActivated(Event):
    """All ``count`` primitives became DoG; ``psnr_before``: mean over the test views before, None without any."""

    kind, words = "dog_activated", "dog activated {count} primitives"
    columns = MappingProxyType({"psnr_before": "psnr_before"})
    count: int
    psnr_before: float | None = None


@dataclass(frozen=True)
class RowsActivated(Event):
    """All ``count`` primitives got rows of a kind, of zeros or next to it; a class of its own for each kind."""

    count: int


@dataclass(frozen=True)
class RowsLeftOut(Event):
    """``count`` primitives lost their rows of a kind, which no pixel shows; ``left`` have one still."""

    count: int
    left: int


def _of_each_kind(record: type[Event], did: str, words: str) -> dict[str, type[Any]]:
    """Classes by kinds of rows."""
    facts = {rows: {"kind": f"{rows}_{did}", "words": f"{rows.replace('_', ' ')} {words}"} for rows in NAMED}
    return {rows: type(record.__name__, (record,), of_kind) for rows, of_kind in facts.items()}


ROWS_ACTIVATED: dict[str, type[RowsActivated]] = _of_each_kind(
    RowsActivated, "activated", "activated for {count} primitives"
)
ROWS_LEFT_OUT: dict[str, type[RowsLeftOut]] = _of_each_kind(RowsLeftOut, "left_out", "left out: {count}, kept: {left}")


@dataclass(frozen=True)
class Quantised(Event):
    """The model became what its file holds; ``entries`` of the palette."""

    kind, words = "quantised", "quantised for {format}: palette of {entries}"
    format: str
    entries: int


@dataclass(frozen=True)
class PosesRefined(Event):
    """How far the training cameras are from where the data have them: ``shift`` in parts of the extent, ``turn``."""

    kind = "poses_refined"
    words = "poses refined: by {shift:.2%} of the extent and {turn:.3f} degrees (median)"
    shift: float
    turn: float  # degrees
