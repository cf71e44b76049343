"""Blurs with SSIM's window across the rows of an image, a lane for several pixels: what the loss is made of.

The window is separable, and a lane computes ``BLOCK`` neighbouring outputs, so that each loaded value serves up to
eight of them. Every pass runs *across* the rows of its input (consecutive lanes read consecutive addresses); a lane's
eight outputs are then consecutive in the *transposed* plane, one packet store. Sizes are opaque: images of all sizes
share the kernels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ...engine.arrays import array_types, detached
from ...engine.parameters import device_array

RADIUS = 5
BLOCK = 8  # a power of two (packet stores), at least RADIUS (a window reaches no further than the next block)


def gaussian_window() -> list[float]:
    """The 11 weights of SSIM's window along one axis (sigma 1.5, sum 1)."""
    weights = np.exp(-0.5 * (np.arange(-RADIUS, RADIUS + 1) / 1.5) ** 2)
    return (weights / weights.sum()).tolist()


WEIGHTS = gaussian_window()


@dataclass
class Sweep:
    """A blur across the rows of planes [3, rows, columns]: one lane per channel, block of rows, and column.

    Columns vary fastest over the lanes. A lane's ``values`` are its rows -RADIUS ... BLOCK + RADIUS - 1,
    counted from the first row of its block, zero outside the image. A quantity "in the lanes' order" is a
    list of BLOCK arrays, one per row of the block, each with one entry per lane.
    """

    channel: Any  # UInt of each lane
    column: Any
    first: Any  # row, of the lane's block
    rows: Any  # UInt, opaque
    columns: Any
    n_blocks: Any
    transposed_stride: Any
    transposed_size: int

    @staticmethod
    def of(rows: int, columns: int) -> Sweep:
        """Across ``rows`` rows of ``columns`` values."""
        blocks = -(-rows // BLOCK)
        channel, block, column = np.indices((3, blocks, columns), np.uint32).reshape(3, -1)
        # arrays that share memory with NumPy are aligned by chance, and each chance is another kernel
        lanes = [detached(device_array(v, mi.UInt32)) for v in (channel, column, block * BLOCK)]
        sizes = [dr.opaque(array_types().UInt, v) for v in (rows, columns, blocks, blocks * BLOCK)]
        return Sweep(*lanes, *sizes, transposed_size=3 * columns * blocks * BLOCK)

    def row(self, j: int) -> tuple[Any, Any]:
        """Row ``j`` of the block, counted in its channel, and whether it lies in the image."""
        row = self.first + array_types().UInt(j % 2**32)  # wraps above the image, and so fails the comparison
        return row, row < self.rows

    def indices(self, stride: Any, span: range) -> list[tuple[Any, Any]]:
        """Index and mask of the rows ``span`` of the block in a plane whose rows are ``stride`` apart."""
        base = dr.fma(self.channel * self.rows, stride, self.column)
        return [(dr.fma(row, stride, base), inside) for row, inside in map(self.row, span)]

    def values(self, planes: list[Any], stride: Any) -> list[list[Any]]:
        """The lane's values from each of several planes, each [3, rows, stride]."""
        at = self.indices(stride, range(-RADIUS, BLOCK + RADIUS))
        return [[dr.gather(type(p), p, index, inside) for index, inside in at] for p in planes]

    def values_from_blocks(self, blocks: list[list[Any]]) -> list[list[Any]]:
        """The lane's values from quantities in the lanes' order (evaluated, zero outside the image)."""
        lane = dr.arange(array_types().UInt, dr.width(self.column))
        above, below = lane - self.columns, lane + self.columns
        head = [(BLOCK + j, above, self.row(j)[1]) for j in range(-RADIUS, 0)]
        tail = [(j, below, self.row(BLOCK + j)[1]) for j in range(RADIUS)]

        def gather(block: list[Any], at: list[tuple[int, Any, Any]]) -> list[Any]:
            return [dr.gather(type(block[k]), block[k], index, inside) for k, index, inside in at]

        return [[*gather(b, head), *b, *gather(b, tail)] for b in blocks]

    def store_transposed(self, blocks: list[list[Any]]) -> list[Any]:
        """Write quantities in the lanes' order as planes [3, columns, transposed_stride], in one kernel."""
        packet = dr.fma(dr.fma(self.channel, self.columns, self.column), self.n_blocks, self.first // BLOCK)
        Floats = array_types().Floats
        planes = []
        for block in blocks:
            plane = dr.empty(type(block[0]), self.transposed_size)
            dr.scatter(plane, Floats(block), packet)
            planes.append(plane)
        dr.eval(planes)
        return planes


def blur(values: list[Any]) -> list[Any]:
    """Window means at a lane's BLOCK rows, from its BLOCK + 2 RADIUS values."""
    means = []
    for k in range(BLOCK):
        mean = values[k] * WEIGHTS[0]
        for value, weight in zip(values[k + 1 : k + len(WEIGHTS)], WEIGHTS[1:], strict=True):
            mean = dr.fma(value, weight, mean)
        means.append(mean)
    return means
