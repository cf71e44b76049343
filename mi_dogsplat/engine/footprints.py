"""Which tiles, and which blocks of pixels inside them, a projected primitive covers.

It covers what its level set {2^p >= cutoff} meets, with pixels taken at their centres; for a DoG primitive that of
either kernel, for one that is cut off that of the whole kernel times the largest factors of its cuts. The set is an
ellipse; within a band of pixel rows its leftmost and rightmost points are known in closed form, so nothing is listed
that the ellipse does not enter ("AccuTile", Speedy-Splat 2024).
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import drjit as dr

from .arrays import array_types, constant, detached
from .cuts import LOG2_LARGEST
from .geometry import Blocks, Grid
from .project import Projection
from .rows import NO_ROW
from .screen_kernels import LN2, Kernels

SLACK = 1e-3  # px, above the rounding error of the spans


class _Ellipses:
    """Level sets {p >= -log2_range} of kernels, one per lane: (ux dx + uy dy)² + (vy dy)² <= t.

    That is dᵀ Σ'⁻¹ d <= 2 ln 2 t, an ellipse. Along a direction e it reaches as far as √(2 ln 2 t eᵀ Σ' e), and does so
    at Σ' e / (eᵀ Σ' e) times that (Cauchy-Schwarz): hence its extents, and its rightmost point. A row dy cuts it where
    dx = -uy / ux dy ± √(t - (vy dy)²) / ux; within a band of rows that is largest at the rightmost point, or where the
    band ends before it.
    """

    def __init__(self, kernels: Kernels, log2_range: float, lookup=lambda v: v):
        def column(v):
            return lookup(detached(v))

        self.width, self.vy = dr.rcp(column(kernels.ux)), column(kernels.vy)
        self.slope = -column(kernels.uy) * self.width  # dx of the ellipse's middle per dy
        self.t = column(kernels.lo) + log2_range
        self.seen = self.t > 0
        t = dr.maximum(self.t, 0)
        # half extents
        self.extent_x = dr.sqrt(2 * LN2 * t * column(kernels.variance_x))
        self.extent_y = dr.sqrt(2 * LN2 * t * column(kernels.variance_y))
        # y of the rightmost point, Σ'_xy / Σ'_xx of its x; the leftmost is its mirror image
        covariance = self.slope * column(kernels.variance_y)
        self.y_right = covariance / column(kernels.variance_x) * self.extent_x

    @classmethod
    def of(cls, values: dict[str, Any]) -> _Ellipses:
        """Those whose ``vars`` are these."""
        found = cls.__new__(cls)
        vars(found).update(values)
        return found

    def at(self, chosen: Callable[[Any], Any]) -> _Ellipses:
        """The same of ``chosen`` kernels."""
        return self.of({name: chosen(value) for name, value in vars(self).items()})

    def span(self, y0, y1) -> tuple:
        """Leftmost and rightmost dx of the ellipse within dy in [y0, y1]; (inf, -inf) where it misses the band."""
        y0, y1 = dr.maximum(y0, -self.extent_y), dr.minimum(y1, self.extent_y)
        meets = self.seen & (y0 <= y1)

        def side(y, sign):
            v = self.vy * y
            return dr.fma(self.slope, y, sign * self.width * dr.sqrt(dr.maximum(dr.fma(-v, v, self.t), 0)))

        right = side(dr.clip(self.y_right, y0, y1), 1)
        left = side(dr.clip(-self.y_right, y0, y1), -1)
        return dr.select(meets, left, dr.inf), dr.select(meets, right, -dr.inf)


class Footprints:
    """Tile rows and, row by row, the columns of tiles and of blocks that a primitive covers."""

    def __init__(self, projection: Projection, grid: Grid, log2_range: float):
        self.blocks, self.types = grid.blocks, array_types()
        Float = self.types.Float
        self.x, self.y = detached(projection.x), detached(projection.y)
        log2_range += projection.planes * LOG2_LARGEST
        self.ellipses = [_Ellipses(projection.kernels, log2_range)]
        extent_y = dr.select(self.ellipses[0].seen, self.ellipses[0].extent_y, -1)
        if projection.pseudo is not None:
            row = detached(projection.dog_row)
            is_dog = row != NO_ROW
            other = _Ellipses(projection.pseudo, log2_range, lambda v: dr.gather(Float, v, row, is_dog))
            other.seen &= is_dog
            self.ellipses.append(other)
            extent_y = dr.maximum(extent_y, dr.select(other.seen, other.extent_y, -1))
        Int = self.types.Int
        self.tiles_x = constant(Int, "tiles_x", grid.tiles_x)
        self.tiles_y = constant(Int, "tiles_y", grid.tiles_y)
        visible = detached(projection.visible) & (extent_y >= 0)
        top, bottom, b = self.y - extent_y, self.y + extent_y, self.blocks
        first, last = self._range(top, bottom, b.tile_height + b.overlap, b.tile_height, self.tiles_y)
        self.first = dr.select(visible, first, 0)
        self.last = dr.select(visible, last, 0)  # exclusive
        self.top = self.types.Int(0)  # the first tile row

    def kept(self) -> list:
        """What the spans are made of."""
        return [self.x, self.y, self.first, self.last, *(vars(ellipse) for ellipse in self.ellipses)]

    @classmethod
    def of(cls, kept: list, tiles_x: Any, blocks: Blocks) -> Footprints:
        """Of what ``kept`` gave: a frozen function takes arrays alone."""
        found = cls.__new__(cls)
        found.blocks, found.types, found.tiles_x = blocks, array_types(), tiles_x
        found.x, found.y, found.first, found.last, *ellipses = kept
        found.ellipses = [_Ellipses.of(values) for values in ellipses]
        return found

    def in_rows(self, rows: range) -> Footprints:
        """The same, of the tile rows ``rows`` alone."""
        band = copy.copy(self)
        band.top = constant(self.types.Int, "top", rows.start)
        bottom = constant(self.types.Int, "bottom", rows.stop)
        band.first, band.last = dr.maximum(self.first, band.top), dr.minimum(self.last, bottom)
        return band

    def at(self, splat) -> Footprints:
        """Those of the primitives ``splat``, as many as there are, in any order."""

        def chosen(value):
            return dr.gather(type(value), value, splat) if dr.is_array_v(value) else value

        found = copy.copy(self)
        for name in ("x", "y", "first", "last"):
            setattr(found, name, chosen(getattr(self, name)))
        found.ellipses = [ellipse.at(chosen) for ellipse in self.ellipses]
        return found

    def _range(self, low, high, size: int, stride: int, count) -> tuple:
        """Runs of ``size`` pixels, ``stride`` apart, whose pixel centres meet [low, high], as [first, last)."""
        limit = self.types.Float(count)
        first = dr.ceil((low - SLACK - (size - 0.5)) * (1 / stride))
        last = dr.floor((high + SLACK - 0.5) * (1 / stride)) + 1
        return tuple(self.types.Int(dr.clip(v, 0, limit)) for v in (first, last))

    def _span(self, top, height: int) -> tuple:
        """x of the leftmost and rightmost point within ``height`` rows of pixel centres from row ``top`` on."""
        y0 = type(self.x)(top) + (0.5 - SLACK) - self.y
        y1 = y0 + (height - 1 + 2 * SLACK)
        left, right = self.ellipses[0].span(y0, y1)
        for other in self.ellipses[1:]:
            other_left, other_right = other.span(y0, y1)
            left, right = dr.minimum(left, other_left), dr.maximum(right, other_right)
        return self.x + left, self.x + right

    def columns(self, row) -> tuple:
        """Tile columns [first, last) that the primitive covers in tile row ``row``."""
        b = self.blocks
        left, right = self._span(row * b.tile_height, b.tile_height + b.overlap)
        first, last = self._range(left, right, b.tile_width + b.overlap, b.tile_width, self.tiles_x)
        return first, dr.maximum(first, last)

    def block_columns(self, row) -> list[tuple]:
        """The same, for each row of blocks in tile row ``row``: block columns of the image."""
        b, found = self.blocks, []
        for k in range(b.lanes_y):
            left, right = self._span(row * b.tile_height + k * b.stride_y, b.height)
            found.append(self._range(left, right, b.width, b.stride_x, self.tiles_x * b.lanes_x))
        return found

    def lane_mask(self, block_columns: list[tuple], column):
        """A bit per lane of a tile, ``column`` of its row: whether the primitive covers its block."""
        UInt, b, bits = self.types.UInt, self.blocks, self.types.UInt(0)
        for k, (first, last) in enumerate(block_columns):
            first, last = (dr.clip(v - column * b.lanes_x, 0, b.lanes_x) for v in (first, last))
            run = (UInt(1) << UInt(last)) - (UInt(1) << UInt(first))
            bits |= dr.select(first < last, run, 0) << (k * b.lanes_x)
        return bits
