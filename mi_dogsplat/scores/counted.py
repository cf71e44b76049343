"""Which pixels of the training views count, and how much: what masks paint black, the loss does not see, nor does a
score."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from ..engine.arrays import detached
from ..engine.parameters import device_array

MaskOf: TypeAlias = Callable[[int], np.ndarray | None]  # [H, W] of a view, 1 where a pixel counts, else 0; None: all do
WeightOf: TypeAlias = MaskOf  # the same, or how much a squared change of a pixel counts


def counted(masks: MaskOf | None, view: int) -> Any:
    """[H*W] on the device, of the view with this number; None where all of its pixels count."""
    mask = masks(view) if masks else None
    return None if mask is None else detached(device_array(mask))
