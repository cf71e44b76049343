"""What the render of a training view is compared with: not all of a photograph says what the scene looks like.

- Pixels that a **mask** paints black say nothing.
- **Saturated** pixels, where the sensor was full, say that the scene is at least as bright as they are. A render that
  is brighter agrees with them. RawNeRF (Mildenhall et al. 2022) clips renders likewise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr

from ...engine.arrays import detached
from .loss import Target


@dataclass(frozen=True)
class Truth:
    """A photograph as the loss sees it.

    Args:
        target: made of the masked photograph.
        mask: plane [H W], 1 where a pixel counts, 0 where it does not; None where all count.
        bounds: three planes [H W], the photograph where it is saturated, infinite elsewhere; None where it is nowhere.
    """

    target: Target
    mask: Any = None
    bounds: list | None = None

    def comparable(self, planes: list) -> list:
        """Three planes [H W] of a render, with what the photograph cannot tell from it made equal to the photograph."""
        if self.bounds is not None:
            planes = [dr.minimum(x, bound) for x, bound in zip(detached(planes), self.bounds, strict=True)]
        return planes if self.mask is None else [x * self.mask for x in detached(planes)]

    def gradient(self, gradient: list, planes: list) -> list:
        """By ``planes``, of a function with a ``gradient`` by what is ``comparable`` of them."""
        if self.bounds is not None:
            three = zip(gradient, detached(planes), self.bounds, strict=True)
            gradient = [dr.select(x > bound, 0, δ) for δ, x, bound in three]
        return gradient if self.mask is None else [δ * detached(self.mask) for δ in gradient]
