"""Models of which some primitives have a colour that varies over them, for the twins.

Such a model has the primitives `slope_index` [S] with `color_slopes` [S, 3, 3]: the change of colour per standard
deviation along each axis of the primitive (axis, channel). A model that has no such arrays is of even colours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..scene.splats import Splats


def slope_index(splats: Splats) -> np.ndarray:
    """[S] the primitives whose colour varies."""
    return np.asarray(getattr(splats, "slope_index", ()), np.int64)


def slope_names(splats: Splats) -> tuple[str, ...]:
    """The name of their slopes, where there is such a primitive."""
    return ("color_slopes",) if len(slope_index(splats)) else ()


def color_slopes(splats: Splats) -> np.ndarray:
    """[S, 3, 3] float64."""
    return np.asarray(splats.color_slopes, np.float64) if slope_names(splats) else np.zeros((0, 3, 3))
