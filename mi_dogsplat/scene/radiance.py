"""Models of linear radiance in another unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .drawing import DrawnAs
from .row_groups import CURVATURES, SH, SLOPES
from .sh_basis import C0
from .splats import Splats


def brightened(splats: Splats, factor: float) -> Splats:
    """The model with all colours times ``factor``: SH(direction) + 0.5, and so all they are made of."""
    sh_coeffs = splats.sh_coeffs * factor
    sh_coeffs[:, 0] += 0.5 * (factor - 1) / C0
    names = [name for group in (SLOPES, CURVATURES, *SH.values()) for name in group.names]
    groups = {name: getattr(splats, name) * np.float32(factor) for name in names}
    return replace(splats, sh_coeffs=sh_coeffs, **groups)


def in_units_of_white(splats: Splats, drawn: DrawnAs) -> Splats:
    """A linear model in units of its white, in which it is fitted and put on grids; any other as it is."""
    return brightened(splats, 1 / drawn.white) if drawn.linear else splats


def from_units_of_white(splats: Splats, drawn: DrawnAs) -> Splats:
    """The inverse of ``in_units_of_white``."""
    return brightened(splats, drawn.white) if drawn.linear else splats
