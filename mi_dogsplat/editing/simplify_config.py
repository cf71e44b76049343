"""How a model becomes a simpler one; what stands beside a field's type is the help text of its flag."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated

from ..support.settings import Setting, check_settings, refuse

TARGET = "primitives that are left: a ratio (0.1, 10%) or a count (20000)"
STEPS = "of the fit to renders of the model; 0: merge alone, which takes seconds"
VIEWS = "renders to fit to, from around the model and from within"
SIZE = "width and height of these renders, in pixels"
DOG = "end with Differences of Gaussians, fitted in the second half of the steps"


@dataclass(frozen=True)
class SimplifyConfig:
    """Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed."""

    target: Annotated[str, Setting(TARGET, "X")] = "10%"
    steps: Annotated[int, Setting(STEPS, least=0)] = 2000
    views: Annotated[int, Setting(VIEWS, least=2)] = 96
    size: Annotated[tuple[int, int], Setting(SIZE, "W H")] = (400, 300)
    dog: Annotated[bool, Setting(DOG)] = False
    seed: Annotated[int, Setting("seed of the places of cameras, and of their order", least=0, most=2**31 - 1)] = 0

    def __post_init__(self) -> None:
        check_settings(self)
        if min(self.size) < 16:
            refuse("size", f"{self.size[0]} x {self.size[1]} is too small", "use at least 16 x 16")
        if self._target() is None:
            refuse("target", f"{self.target} is no target", "use a ratio below 1 (0.1, 10%) or a whole number")
        if self.dog and self.steps < 2:
            refuse("dog", f"{self.steps} steps fit none", "use --steps 2 or more")

    def count(self, n: int) -> int:
        """How many primitives the target is of ``n``. Raises ``DataError`` for none, or not fewer."""
        number = self._target() or 0
        count = int(number) if number >= 1 else round(number * n)
        if count < 1:
            refuse("target", f"{self.target} of {n} primitives leaves none", "use a larger one")
        if count >= n:
            refuse("target", f"{count} primitives are not fewer than the {n} that there are", "use a smaller one")
        return count

    def _target(self) -> float | None:
        """A ratio below 1, or a whole number; None for what is neither."""
        if not (found := re.fullmatch(r"(\d+\.?\d*|\.\d+)(%?)", str(self.target))):
            return None
        number = float(found[1]) / (100 if found[2] else 1)
        if 0 < number < 1 or (not found[2] and number >= 1 and number.is_integer()):
            return number
        return None
