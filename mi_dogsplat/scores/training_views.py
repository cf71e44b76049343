"""The training views as the loss sees them: what a score sums over.

What masks paint black, the loss does not see, nor does a score. Linear pictures are seen through a tone curve: a change
of a pixel shows times the slope of the curve there. So the energy of a change, a sum of squares over pixels, is that of
the linear picture with a weight on each pixel, the square of the slope. That is exact for small changes only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions


class Curve(Protocol):
    """A tone curve, ``training/images/tone_curve.py``."""

    def slope(self, x: Any) -> Any:
        """Its derivative."""
        ...


def whole(view: int) -> None:
    """Stands for the masks of a data set that has none: all pixels of a view count."""


@dataclass(frozen=True)
class TrainingViews:
    """All training views of a run, how they are rendered, and which of their pixels count."""

    cameras: Sequence[DeviceCamera]
    options: RasterOptions
    background: float = 0.0  # grey level behind the primitives
    mask: Callable[[int], np.ndarray | None] = whole  # [H, W] of a view, 1 where a pixel counts, else 0; None: all do
    curve: Curve | None = None  # through which linear pictures are seen


def mean_slope(curve: Curve, image: list) -> np.ndarray:
    """[H*W] of a curve at a picture of three planes [H*W], the mean over these."""
    return np.mean([curve.slope(plane).numpy() for plane in image], axis=0)
