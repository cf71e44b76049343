"""Rows of numbers and words, whatever columns they have, as HTML tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from ..report.plot import number
from ..support.wording import MISSING, count, finite

BAD = ("wrong", False)  # what makes a cell stand out
FEW = 4  # entries of a list that a cell shows
SMALL = 1e-3  # below, numbers are errors, of which two digits are enough


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """One line per row; columns are the keys of all rows in the order they come. Nothing without a row.

    Rows that have a ``group`` stand under its name. A cell that is a mapping of numbers shows the largest of them and
    its name.
    """
    if not rows:
        return ""
    columns = [key for key in dict.fromkeys(key for row in rows for key in row) if key != "group"]
    right = {c: all(_is_number(row[c]) for row in rows if row.get(c) is not None) for c in columns}
    heads = "".join(f"<th{_align(right[c])}>{escape(c.replace('_', ' '))}</th>" for c in columns)
    body, group = "", None
    for row in rows:
        if row.get("group") not in (None, "", group):
            group = row["group"]
            body += f"<tr class=group><th colspan={len(columns)}>{escape(str(group))}</th></tr>"
        body += f"<tr>{''.join(_td(row.get(c), right[c]) for c in columns)}</tr>"
    return f"<div class=scroll><table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>"


def facts(values: Mapping[str, Any]) -> str:
    """Names and single values, side by side."""
    pairs = "".join(f"<div><dt>{escape(k.replace('_', ' '))}</dt><dd>{cell(v)}</dd></div>" for k, v in values.items())
    return f"<dl class=facts>{pairs}</dl>"


def cell(value: object) -> str:
    """HTML of a value: ``1.2e−7``, ``3,000``, ``yes``, or a dash where there is nothing."""
    if value is None:
        return MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return count(value)
    if isinstance(value, float):
        return _rounded(value)
    if isinstance(value, Mapping):
        numbers = {str(k): v for k, v in value.items() if finite(v) is not None}
        if not numbers:
            return MISSING
        worst = max(numbers, key=lambda k: numbers[k])
        return f"{cell(float(numbers[worst]))} <small>{escape(worst)}</small>"
    if isinstance(value, list | tuple):
        return ", ".join(map(cell, value)) if len(value) <= FEW else f"{len(value)} values"
    return escape(str(value))


def _rounded(value: float) -> str:
    if finite(value) is None:
        return MISSING
    if 0 < abs(value) < SMALL:
        return f"{value:.1e}".replace("e-0", "e-").replace("-", "\u2212")
    return number(float(f"{value:.3g}"))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float | Mapping) and not isinstance(value, bool)


def _td(value: object, right: bool) -> str:
    bad = any(value is b or (isinstance(b, str) and value == b) for b in BAD)
    return f"<td{_align(right, bad)}>{cell(value)}</td>"


def _align(right: bool, bad: bool = False) -> str:
    classes = " ".join(name for name, on in (("n", right), ("bad", bad)) if on)
    return f' class="{classes}"' if classes else ""
