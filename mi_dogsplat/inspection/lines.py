"""What several descriptions of ``dogsplat info`` have in common."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..scene.drawing import Drawing, told
from ..scene.splats import Splats
from ..support.wording import count

NAMES_SHOWN = 4


def line(name: str, value: str) -> str:
    """A name, and its value in the second column."""
    return f"  {name:16s}{value}"


def problem_lines(problems: Sequence[str]) -> list[str]:
    """The end of a description."""
    return ["problems:", *(f"  {problem}" for problem in problems)] if problems else ["problems: none found"]


def sh_degrees(splats: Splats) -> str:
    """``3``, or how many primitives have each."""
    if not splats.mixed_sh:
        return f"{splats.sh_degree}"
    degrees, counts = np.unique(splats.sh_degrees, return_counts=True)
    return ", ".join(f"{degree}: {count(int(k))}" for degree, k in zip(degrees, counts, strict=True))


def drawn(drawing: Drawing) -> str:
    """``antialiased, near clip 0.2``."""
    words = [name if value is True else f"not {name}" for name, value in drawing.said().items() if type(value) is bool]
    numbers = {name: told(value) for name, value in drawing.said().items() if type(value) is not bool}
    named = [f"{name.replace('_', ' ')} {value}" for name, value in numbers.items()]
    return ", ".join(words + named)


def first_names(names: list[str]) -> str:
    """Some of them, and how many more there are."""
    more = len(names) - NAMES_SHOWN
    return ", ".join(names[:NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")
