"""Rows of numbers and words, whatever columns they have, as tables of a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from ..report.ticks import number
from ..support.wording import MISSING, count, finite

BAD = ("wrong", False)  # what makes a cell stand out
FEW = 4  # entries of a list that a cell shows
SMALL = 1e-3  # below, numbers are errors, of which two digits are enough


class Cell(NamedTuple):
    """What a value is shown as: ``text`` and, smaller, whose it is."""

    text: str
    of: str = ""
    bad: bool = False


@dataclass(frozen=True)
class Table:
    """``columns`` are headings, and whether numbers stand under them; ``groups`` are names, or None, and rows."""

    columns: Sequence[tuple[str, bool]]
    groups: Sequence[tuple[str | None, Sequence[Sequence[Cell]]]]


def table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """One line per row; columns are the keys of all rows in the order they come.

    Rows that have a ``group`` stand under its name. A cell that is a mapping of numbers shows the largest of them and
    its name.
    """
    columns = [key for key in dict.fromkeys(key for row in rows for key in row) if key != "group"]
    right = [all(_is_number(row[c]) for row in rows if row.get(c) is not None) for c in columns]
    groups: list[tuple[str | None, list[list[Cell]]]] = []
    for row in rows:
        name = str(row.get("group") or "") or None
        if not groups or (name and name != groups[-1][0]):
            groups.append((name, []))
        groups[-1][1].append([cell(row.get(c)) for c in columns])
    return Table([(c.replace("_", " "), r) for c, r in zip(columns, right, strict=True)], groups)


def facts(values: Mapping[str, Any]) -> dict[str, str]:
    """Names and single values in words."""
    return {name.replace("_", " "): " ".join(filter(None, cell(value)[:2])) for name, value in values.items()}


def cell(value: object) -> Cell:
    """What a value is shown as: ``1.2e−7``, ``3,000``, ``yes``, or a dash where there is nothing."""
    return Cell(*_shown(value), bad=any(value is b or (isinstance(b, str) and value == b) for b in BAD))


def _shown(value: object) -> tuple[str, str]:
    """Text of a cell, and whose it is."""
    if isinstance(value, Mapping):
        numbers = {str(k): v for k, v in value.items() if finite(v) is not None}
        worst = max(numbers, key=lambda k: numbers[k], default="")
        return (_text(float(numbers[worst])), worst) if numbers else (MISSING, "")
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, value)) if len(value) <= FEW else f"{len(value)} values", ""
    return _text(value), ""


def _text(value: object) -> str:
    if value is None:
        return MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return count(value)
    return _rounded(value) if isinstance(value, float) else str(value)


def _rounded(value: float) -> str:
    if finite(value) is None:
        return MISSING
    if 0 < abs(value) < SMALL:
        return f"{value:.1e}".replace("e-0", "e-").replace("-", "\u2212")
    return number(float(f"{value:.3g}"))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float | Mapping) and not isinstance(value, bool)
