"""Whose values the rows of a parameter are: every primitive's, or those of a group."""

from __future__ import annotations

import numpy as np

from ..engine.parameters import RAW, RAW_OF_GROUPS
from ..scene.row_groups import BESIDE_COLORS
from ..scene.splats import Splats

NAMES = RAW + RAW_OF_GROUPS  # of all that a model which is not mixed may have


def rows_of(splats: Splats, name: str) -> np.ndarray:
    """The primitives of the rows of a raw parameter, increasing. A mixed model's coefficients are not looked at."""
    for group in BESIDE_COLORS:
        if name in group.names:
            return getattr(splats, group.index)
    return np.arange(splats.n_splats)
