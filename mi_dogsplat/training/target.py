"""What a training is to end with: a part of its primitives, so many primitives, or a file of so many bytes."""

from __future__ import annotations

import re

from ..support.memory import bytes_of
from ..support.settings import refuse
from ..support.wording import count

REMEDY = "use a ratio below 1 (0.1, 10%), a whole number of primitives (20000), or the size of the file (2MB)"


def checked_target(target: float | str) -> float | str:
    """A ratio or a count as a number, a size as it was written, without blanks.

    Raises ``ValueError`` for what is neither.
    """
    text = f"{target:g}" if isinstance(target, (int, float)) else target.replace(" ", "")
    if target_bytes(text) is not None:
        return text
    percent = re.fullmatch(r"(.+)%", text)
    try:
        number = float(target if isinstance(target, (int, float)) else percent[1] if percent else text)
    except ValueError:
        number = 0.0
    if percent:
        number = number / 100 if number < 100 else 0.0
    elif number == 1 and isinstance(target, str) and "." in text:
        number = 0.0  # 1.0 means all of them, and not a single one
    if 0 < number < 1 or (number >= 1 and number.is_integer()):  # NaN is neither
        return number
    raise ValueError(f"{text} is not a target")


def target_bytes(target: float | str) -> int | None:
    """Bytes of a size, as 2MB, 500kB or 2MiB; None for other targets."""
    if not isinstance(target, str) or not re.search(r"\d\s*([kmg]i?)?b$", target, re.IGNORECASE):
        return None
    try:
        return bytes_of(target) or None
    except ValueError:
        return None


def target_in_words(target: float | str) -> str:
    """A target as people read it: ``0.1``, ``1,234,567``, or a size as it was written."""
    return target if isinstance(target, str) else count(target) if target >= 1 else f"{target:g}"


def require_below_cap(setting: str, target: float, max_primitives: int | None) -> None:
    """Raise ``DataError``, which names the flag of a setting, for a count that is not below the cap of primitives."""
    if max_primitives is not None and target >= max_primitives:
        problem = f"{target_in_words(target)} primitives are not fewer than --max-primitives {count(max_primitives)}"
        refuse(setting, problem, "use a smaller target or a larger cap")
