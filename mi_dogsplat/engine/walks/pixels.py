"""The pixels of the lanes: planes of the image read into blocks, and blocks written to planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..arrays import array_types
from ..geometry import Grid, Lanes


@dataclass
class Planes:
    """A value per pixel, [H*W] each: blended features, without background, and the transmittance behind all of them."""

    features: list
    T: Any


class BlockPixels:
    """Trace-time helper: the pixels of one lane's block, row by row."""

    def __init__(self, grid: Grid, lanes: Lanes):
        self.types, self.count, x, y = array_types(), grid.blocks.width * grid.blocks.height, lanes.x, lanes.y
        self.n_image, rows, columns = grid.width * grid.height, range(grid.blocks.height), range(grid.blocks.width)
        in_column = [(x + k) < lanes.width for k in columns]
        in_row = [(y + k) < lanes.height for k in rows]
        self.inside = [r & c for r in in_row for c in in_column]  # of the image
        first = dr.fma(y, lanes.width, x)
        self.index = [dr.fma(lanes.width, r, first + c) for r in rows for c in columns]

    def zeros(self, planes: int = 1) -> list:
        """0 at all pixels, of some planes one after the other."""
        return [self.types.Float(0)] * (planes * self.count)

    def read(self, plane: Any) -> list:
        """A value per pixel."""
        return [dr.gather(self.types.Float, plane, i, ok) for i, ok in zip(self.index, self.inside, strict=True)]

    def write(self, planes: list[list], above: Sequence = (), where: Any = True) -> list:
        """Planes, interleaved in fours: [H*W, 4] arrays, which ``planes_of`` takes apart.

        ``above`` is what was returned for the bands above, to be written to (``bands.py``), or by another kernel;
        where ``where`` is false it is left as it is.

        Four at a time cost a fourth of what single values do. Written pixel by pixel: Dr.Jit computes values in the
        order in which they are written, and so needs fewer at once.
        """
        quads = [planes[k : k + 4] for k in range(0, len(planes), 4)]
        quads[-1] += [self.zeros()] * (4 - len(quads[-1]))
        targets = list(above) or [dr.empty(self.types.Float, 4 * self.n_image) for _ in quads]
        for k, (index, ok) in enumerate(zip(self.index, self.inside, strict=True)):
            for target, quad in zip(targets, quads, strict=True):
                four = self.types.Quad([values[k] for values in quad])
                dr.scatter(target, four, index, ok & where, mode=dr.ReduceMode.Permute)
        return targets


def planes_of(interleaved: list, count: int) -> list:
    """The first ``count`` planes, [H*W] each, of what ``BlockPixels.write`` wrote; gathered by the kernels that use
    them."""
    types = array_types()
    index = dr.arange(types.UInt, dr.width(interleaved[0]) // 4)
    return [plane for quads in interleaved for plane in dr.gather(types.Quad, quads, index)][:count]
