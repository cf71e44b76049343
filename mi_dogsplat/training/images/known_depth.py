"""The loss of a render's depths, where depth maps know better, and its gradient.

A pixel of a render has the planes D = Σ z α T and T, what is left of the light: its expected depth is D / (1 - T). With
a known depth d its error is

    e = |D / (1 - T) / d - 1|,

and the loss is ``WEIGHT`` times the mean of that over all pixels; one without a known depth, or where next to nothing
is drawn, adds nothing. The absolute value lets a pixel whose map is wrong, as beside edges, pull no harder than others.

Kerbl et al. (3DGS, training with depths) compare 1 / z in the same way, which asks little of what is far. In a room,
with maps that were relative inverse depth, models were as near to the truth with either, at equal weights.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...datasets.depths import Depths
from ...engine.arrays import detached
from ...engine.parameters import device_array
from ...engine.rasterize import Frame
from .photographs import Photographs

WEIGHT = 0.5  # of photometric losses near .05; docs/training_options.md says what others give
LEAST_DRAWN = 1e-3  # of a pixel, 1 - T: with less the expected depth is that of nothing


class KnownDepths:
    """The depth maps of training views as the loss needs them, in the size in which ``photographs`` show these now.

    They are on the device, 4 bytes per pixel, or read when they are due where the photographs are. Raises ``DataError``
    for maps that cannot be read, then or when they are due.
    """

    def __init__(self, depths: Depths, photographs: Photographs):
        self.maps, self._photographs = depths, photographs
        self._factor, self._held = photographs.factor, {}
        if not photographs.on_disk:
            for view in range(len(photographs)):
                self._plane(view)

    def gradient(self, frame: Frame, view: int) -> tuple[list, list]:
        """The planes D and T of a frame of a view, with depth, and the gradient of the loss by each; nothing where the
        view has no map."""
        inverse = self._plane(view)
        return ([], []) if inverse is None else ([frame.depth, frame.T], depth_gradient(frame.depth, frame.T, inverse))

    def _plane(self, view: int) -> Any:
        """What ``inverse_depth`` makes of a view."""
        photographs = self._photographs
        if photographs.factor != self._factor:
            self._factor, self._held = photographs.factor, {}
        if view in self._held:
            return self._held[view]
        plane = inverse_depth(self.maps.of(photographs.views[view]), photographs.shown_mask(view))
        if not photographs.on_disk:
            self._held[view] = plane
        return plane


def inverse_depth(depth: np.ndarray | None, mask: np.ndarray | None) -> Any:
    """A plane [H W] on the device: 1 / depth [H, W], in world units, and 0 where that is 0 (not known) or the mask
    [H, W] is; None without depths."""
    if depth is None:
        return None
    known = depth > 0 if mask is None else (depth > 0) & (mask > 0)
    return device_array(np.where(known, 1 / np.where(known, depth, 1), 0).astype(np.float32))


def depth_gradient(depth: Any, T: Any, inverse: Any) -> list:
    """[d loss / dD, d loss / dT] of planes [H W] of a frame, by the ``inverse_depth`` of its view."""
    depth, T = detached(depth), detached(T)
    drawn = 1 - T
    counts = (inverse > 0) & (drawn > LEAST_DRAWN)
    relative = dr.select(counts, depth * inverse / drawn, 1)  # of the expected depth to the known one
    share = dr.opaque(mi.Float, WEIGHT / dr.width(inverse))
    pull = dr.select(relative == 1, 0, dr.copysign(share, relative - 1) / drawn)
    return [pull * inverse, pull * relative]
