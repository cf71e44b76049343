"""Numbers as people read them: with units, thousands separators, and a dash where there is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real

MISSING = "\u2013"


def finite(value: object) -> float | None:
    """The value as a float, or None where there is no finite number."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    try:
        number = float(value)
    except OverflowError:  # a whole number of 400 digits
        return None
    return number if math.isfinite(number) else None


def fixed(value: object, digits: int) -> str:
    """``27.31``, or a dash where there is no finite number."""
    v = finite(value)
    return MISSING if v is None else f"{v:.{digits}f}"


def count(value: object) -> str:
    """``312,400``."""
    v = finite(value)
    return MISSING if v is None else f"{v:,.0f}"


def counted(number: object, one: str) -> str:
    """``1 primitive``, ``312,400 primitives``."""
    return f"{count(number)} {one}" + ("s" if finite(number) != 1 else "")


def printable(text: str) -> str:
    """One line that no terminal obeys: line ends, control characters and halves of characters are told as escapes."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def in_words(names: Sequence[str]) -> str:
    """``slopes``, ``slopes and cuts``, ``slopes, cuts and bands``; nothing of none."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def time_unit(longest: float) -> tuple[str, int]:
    """The unit in which times up to the ``longest`` are plotted, and its seconds."""
    return ("s", 1) if longest < 180 else ("min", 60) if longest < 3 * 3600 else ("h", 3600)


def duration(seconds: object) -> str:
    """``42.1 s``, ``4 min 12 s``, ``2 h 03 min``."""
    s = finite(seconds)
    if s is None:
        return MISSING
    if s < 59.95:
        return f"{s:.1f} s"
    s = round(s)
    return f"{s // 60} min {s % 60:02d} s" if s < 3600 else f"{s // 3600} h {s % 3600 // 60:02d} min"


def file_size(n_bytes: object) -> str:
    """``18.4 MB`` (powers of 1000, as file managers and the papers count)."""
    size = finite(n_bytes)
    if size is None:
        return MISSING
    for unit in ("bytes", "kB", "MB"):
        if size < 999.5:  # what three digits still show below 1000
            return f"{size:.0f} {unit}" if unit == "bytes" else f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"
