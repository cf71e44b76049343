"""How a model becomes a simpler one; what stands beside a field's type is the help text of its flag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..support.settings import Setting, check_settings, refuse
from ..support.wording import counted
from ..training.strategy.scheduler import target_count
from ..training.target import checked_target, target_bytes

TARGET = "primitives that remain: a ratio (0.1, 10%) or a count (20000)"
STEPS = "steps of fitting to renders of the model; 0: only merge, which takes seconds"
VIEWS = "number of these renders, from around the model and from inside of it"
SIZE = "width and height of these renders, in pixels; every third one is twice as wide and high"
INSIDE = "share of these renders that show the model from free places inside of it; use 1 for a room"
DOG = "end with Differences of Gaussians, which are fitted in the second half of the steps"


@dataclass(frozen=True)
class SimplifyConfig:
    """Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed."""

    target: Annotated[str | float, Setting(TARGET, "X")] = "10%"
    steps: Annotated[int, Setting(STEPS, least=0)] = 1000
    views: Annotated[int, Setting(VIEWS, least=2)] = 96
    size: Annotated[tuple[int, int], Setting(SIZE, "W H")] = (400, 300)
    inside: Annotated[float, Setting(INSIDE, least=0, most=1)] = 0.5
    dog: Annotated[bool, Setting(DOG)] = False
    seed: Annotated[int, Setting("seed of the places of cameras and of their order", least=0, most=2**31 - 1)] = 0

    def __post_init__(self) -> None:
        check_settings(self)
        if min(self.size) < 16:
            refuse("size", f"{self.size[0]} x {self.size[1]} is too small", "use at least 16 x 16")
        self._number()
        if self.dog and self.steps < 2:
            refuse("dog", f"{counted(self.steps, 'step')} cannot fit DoG", "use --steps 2 or more")

    def count(self, n: int) -> int:
        """How many primitives the target is of ``n``. Raises ``DataError`` for none, or not fewer."""
        try:
            return target_count(self._number(), n)
        except ValueError as error:
            refuse("target", str(error), "use one that leaves some primitives, but not all")

    def _number(self) -> float:
        """A ratio below 1, or a whole number. Raises ``DataError``."""
        try:
            if target_bytes(target := checked_target(self.target)) is None:
                return float(target)
        except ValueError:
            pass
        refuse("target", f"{self.target} is not a target", "use a ratio below 1 (0.1, 10%) or a whole number (20000)")
