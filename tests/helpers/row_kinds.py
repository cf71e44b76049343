"""Slopes, curvatures, cuts and shifts by their names, for tests of what is the same of all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from mi_dogsplat.scene.row_groups import RowGroup
from mi_dogsplat.scene.splats import Splats


@dataclass(frozen=True)
class RowKind:
    """A kind of rows in models and optimizers. Files of tests add what they need of it."""

    word: str
    """``slopes``, ``curvatures``, ``cuts``, ``second_cuts`` or ``shifts``"""
    group: RowGroup

    @property
    def name(self) -> str:
        """Of the values; of shifts, whose mean views are a second array."""
        return self.group.names[0]

    def n(self, holder: Any) -> int:
        return getattr(holder, f"n_{self.word}")

    def index(self, holder: Any) -> np.ndarray:
        return getattr(holder, self.group.index)

    def values(self, splats: Splats) -> np.ndarray:
        return getattr(splats, self.name)

    def without(self, splats: Splats) -> Splats:
        return getattr(splats, f"without_{self.word}")()


def of_each(*kinds: RowKind) -> pytest.MarkDecorator:
    """The test runs with each as its ``kind``."""
    return pytest.mark.parametrize("kind", kinds, ids=lambda kind: kind.word)
