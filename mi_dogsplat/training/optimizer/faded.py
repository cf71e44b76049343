"""What has faded until no picture can show it leaves the model."""

from __future__ import annotations

import numpy as np

from ...engine.geometry import Cutoffs
from ...support.errors import DataError
from .splat_optimizer import SplatOptimizer


def drop_faded(optimizer: SplatOptimizer, opacities: np.ndarray) -> None:
    """Remove primitives whose opacity, of [N], is too small to be drawn. Raises ``DataError`` if none would be left."""
    optimizer.keep(not_faded(opacities))


def not_faded(opacities: np.ndarray) -> np.ndarray:
    """Rows of those whose opacity, of [N], is large enough to be drawn. Raises ``DataError`` if there are none."""
    seen = np.flatnonzero(opacities >= Cutoffs().alpha)
    if not len(seen):
        problem = "every primitive has faded, so that no picture would show anything"
        raise DataError("the model in training", problem, "check that its images show more than the background")
    return seen
