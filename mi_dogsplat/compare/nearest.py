"""Equal bytes and equal time: of each method the run that comes nearest to the reference, of runs at several targets.

Nothing is interpolated: every number is that of a whole run, and its size or time stands beside it.
"""

from __future__ import annotations

import math
from typing import Any

from ..training.target import target_in_words
from .methods import METHODS
from .pairs import REFERENCES, first_of

QUANTITIES = {"megabytes": ("bytes", "size, MB", 2), "train_seconds": ("time", "training, s", 0)}
SHOWN = {"psnr": ("PSNR (dB)", 2), "ssim": ("SSIM", 4), "flip": ("FLIP", 4), "lpips": ("LPIPS", 3)}


def candidates(row: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Summaries of a method by target, as its run folders have it; the comparison's own, "", first."""
    return {"": row["summary"]} | {target: other["summary"] for target, other in row.get("others", {}).items()}


def nearest(row: dict[str, Any], quantity: str, value: float) -> str:
    """The target whose runs come nearest to a value, by ratio."""
    found = candidates(row)
    return min(found, key=lambda target: abs(math.log(found[target][quantity]["value"] / value)))


def tables_of_equals(rows: dict[str, Any], own_target: float) -> list[dict[str, Any]]:
    """A table for each of ``QUANTITIES``; none without a compact model.

    Args:
        own_target: of the comparison.
    """
    reference = first_of(REFERENCES, rows)
    if reference is None or len(rows) < 2:
        return []
    tables = []
    for quantity, (what, words, digits) in QUANTITIES.items():
        value = rows[reference]["summary"][quantity]["value"]
        columns = [name for name in SHOWN if any(name in row["summary"] for row in rows.values())]
        lines = []
        for name, row in rows.items():
            target = nearest(row, quantity, value)
            found = candidates(row)[target]
            size, known = found[quantity]["value"], [found.get(column) for column in columns]
            cells = [f"{k['value']:.{SHOWN[c][1]}f}" if k else "" for c, k in zip(columns, known, strict=True)]
            met = float(target) if target else own_target
            told = target_in_words(met) if METHODS[name].compact else "all primitives"
            lines.append([row["label"], told, f"{size:,.{digits}f}", f"{size / value:.2f}", *cells])
        headings = ["method", "target", words, "of the reference", *(SHOWN[column][0] for column in columns)]
        tables.append({"headings": headings, "rows": lines, "reference": rows[reference]["label"], "what": what})
    return tables
