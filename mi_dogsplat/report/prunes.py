"""The prunes of a run in its report: marks on every curve, the drop in the count, and a table that says why."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from ..support.wording import count, finite
from ..training.events import DogActivated, Pruned, Refined
from .plot import Mark
from .run_folder import Run

READ_PRUNES = """Dashed lines in the curves, by the number that stands above them. A check measures the mean L1
of the whole training set and either prunes or lets the model go on refining."""


@dataclass(frozen=True)
class Prune:
    """One prune: its row in the history, and how many primitives there were ``before`` and ``after``."""

    row: int
    before: float
    after: float
    why: str


def prunes(run: Run) -> list[Prune]:
    """All prunes of a history, in order: the rows that say from and to how many primitives."""
    found = []
    for i, row in enumerate(run.history):
        before, after = finite(row.get("pruned_from")), finite(row.get("pruned_to"))
        if before is not None and after is not None:
            reasons = [str(record.get("reason", "")) for record in run.happened(i) if record.get("kind") == Pruned.kind]
            found.append(Prune(i, before, after, "".join(reasons[:1])))
    return found


def marks(run: Run, x: NDArray[np.float64]) -> list[Mark]:
    """Every prune, by number, and the activation of the DoG; ``x`` [rows] is where each history row stands."""
    numbered = [Mark(str(i + 1), float(x[p.row])) for i, p in enumerate(prunes(run))]
    return numbered + [Mark("DoG", float(x[i])) for i in run.rows_with(DogActivated.kind)]


def with_drops(
    run: Run, x: NDArray[np.float64], n: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The count ``n`` [rows] over ``x`` [rows] with the count before each prune put in: it falls at once."""
    found = prunes(run)
    rows = np.array([p.row for p in found], np.intp)
    return np.insert(x, rows, x[rows]), np.insert(n, rows, [p.before for p in found])


def prune_table(run: Run) -> str:
    """Step, from, to, share removed and reason of every prune, as HTML; nothing for a run without one."""
    found = prunes(run)
    if not found:
        return ""
    refined = len(run.rows_with(Refined.kind))
    words = READ_PRUNES + (f" Checks that did not prune: {refined}." if refined else "")
    rows = ""
    for number, prune in enumerate(found, 1):
        removed = 100 * (1 - prune.after / prune.before) if prune.before else 0.0
        counts = (number, finite(run.history[prune.row].get("step")), prune.before, prune.after)
        cells = "".join(f"<td class=n>{count(value)}</td>" for value in counts)
        rows += f"<tr>{cells}<td class='n share'>{removed:.1f} %</td><td>{escape(prune.why)}</td></tr>"
    return (
        f"<h3>Prunes</h3><p class=read>{words}</p><div class=scroll><table class=prunes><thead><tr><th class=n>"
        "<th class=n>step<th class=n>from<th class=n>to<th class='n share'>removed<th>why</tr></thead><tbody>"
        f"{rows}</tbody></table></div>"
    )
