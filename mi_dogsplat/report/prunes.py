"""The prunes of a run in its report: marks on every curve, the drop in the count, and the reason of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..support.wording import finite
from ..training.events import DogActivated, Pruned, Refined
from .plot import Mark
from .run_folder import Run


@dataclass(frozen=True)
class Prune:
    """One prune: its row in the history, and how many primitives there were ``before`` and ``after``."""

    row: int
    step: object
    before: float
    after: float
    why: str

    @property
    def removed(self) -> float:
        """Percent."""
        return 100 * (1 - self.after / self.before) if self.before else 0.0


def prunes(run: Run) -> list[Prune]:
    """All prunes of a history, in order: the rows that say from and to how many primitives."""
    found = []
    for i, row in enumerate(run.history):
        before, after = finite(row.get("pruned_from")), finite(row.get("pruned_to"))
        if before is not None and after is not None:
            reasons = [str(record.get("reason", "")) for record in run.happened(i) if record.get("kind") == Pruned.kind]
            found.append(Prune(i, row.get("step"), before, after, "".join(reasons[:1])))
    return found


def marks(run: Run, x: NDArray[np.floating]) -> list[Mark]:
    """Every prune, by number, and the activation of the DoG; ``x`` [rows] is where each history row stands."""
    numbered = [Mark(str(i + 1), float(x[p.row])) for i, p in enumerate(prunes(run))]
    return numbered + [Mark("DoG", float(x[i])) for i in run.rows_with(DogActivated.kind)]


def with_drops(
    run: Run, x: NDArray[np.floating], n: NDArray[np.floating]
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """The count ``n`` [rows] over ``x`` [rows] with the count before each prune put in: it falls at once."""
    found = prunes(run)
    rows = np.array([p.row for p in found], np.intp)
    return np.insert(x, rows, x[rows]), np.insert(n, rows, [p.before for p in found])


def compares(run: Run) -> bool:
    """Whether checks measured the error by which they prune or do not."""
    return bool(np.isfinite(run.column("train_l1")).any())


def refinements(run: Run) -> int:
    """How many checks let the model go on refining."""
    return len(run.rows_with(Refined.kind))
