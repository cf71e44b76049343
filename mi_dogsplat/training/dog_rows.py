"""Which primitives are DoG, on the host and on the device, where they turn into plain Gaussians without a wait."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from ..engine.parameters import device_array, rows_of_splats
from ..engine.project import NO_ROW
from ..scene.row_groups import row_of_splats

DOG_ROW_SIZE = {"dog_logit_opacities": 1, "dog_log_scales": 3}


class DogRows:
    """The rows of the DoG arrays: ``index`` [M] of their primitives, strictly increasing, of ``n`` primitives."""

    def __init__(self, index: np.ndarray, n: int):
        self.index, self.n = np.array(index, np.uint32), n
        self.dropped = False
        if len(self.index):
            self.on_device = device_array(self.index, mi.UInt32)
            self.row = rows_of_splats(self.index, n)  # [N] of each primitive, or NO_ROW

    @property
    def params(self) -> dict:
        """Arrays for ``rasterize``; none without a DoG primitive."""
        return {"dog_index": self.on_device, "dog_row": self.row} if len(self.index) else {}

    def drop(self, drop: mi.Bool) -> None:
        """Make plain Gaussians of the primitives ``drop`` [N] on the device, at once."""
        self.row = dr.select(drop, NO_ROW, self.row)
        dr.eval(self.row)
        self.dropped = True

    def left(self) -> np.ndarray:
        """[M'] rows that were not dropped. Waits for the device if some may have been."""
        if not self.dropped:
            return np.arange(len(self.index))
        self.dropped = False
        return np.flatnonzero(self.row.numpy()[self.index] != NO_ROW)

    def of_splats(self) -> np.ndarray:
        """[N] row of each primitive, or -1."""
        return row_of_splats(self.index, self.n)
