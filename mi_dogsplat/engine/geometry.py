"""How the image is cut: tiles of pixels, shared by a packet of lanes that own a block of pixels each.

This is all that depends on the backend. A block is unrolled in the compositing kernel, so every parameter that a lane
loads serves the whole block; the lanes of a packet walk down the list of one tile, each past what misses its block.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import drjit as dr
import mitsuba as mi

from .arrays import array_types, constant
from .drjit_internals import llvm_packet

LANES = {16: (4, 4), 8: (4, 2), 4: (2, 2)}  # of a tile on the CPU, by the lanes of a packet


@dataclass(frozen=True)
class Blocks:
    """Pixels per lane, lanes per tile, and primitives per iteration of the compositing loop."""

    width: int  # of a lane's block, pixels
    height: int
    lanes_x: int  # of a tile, lanes
    lanes_y: int
    unroll: int
    adapts: bool = False  # to the length of a step: ``unroll`` is for short ones, longer ones take fewer
    overlap: int = 0  # columns and rows, at the right and at the bottom, that the next block and tile have as well

    @property
    def lanes_per_tile(self) -> int:
        return self.lanes_x * self.lanes_y

    @property
    def stride_x(self) -> int:
        """Pixels from block to block."""
        return self.width - self.overlap

    @property
    def stride_y(self) -> int:
        return self.height - self.overlap

    @property
    def tile_width(self) -> int:
        """Pixels from tile to tile."""
        return self.stride_x * self.lanes_x

    @property
    def tile_height(self) -> int:
        return self.stride_y * self.lanes_y

    def patches(self, size: int) -> Iterator[tuple[range, range]]:
        """(Columns, rows) of patches of ``size`` x ``size`` pixels; those at the right and bottom may be smaller."""
        for top in range(0, self.height, size):
            for left in range(0, self.width, size):
                yield range(left, min(left + size, self.width)), range(top, min(top + size, self.height))

    def tiles_as(self, other: Blocks) -> bool:
        """Whether tiles, and blocks in them, begin at the same pixels."""
        places = [(b.stride_x, b.stride_y, b.lanes_x, b.lanes_y) for b in (self, other)]
        return places[0] == places[1]

    @staticmethod
    def of_backend() -> Blocks:
        """A tile is a packet: 16 x 16 pixels with AVX-512 and on CUDA (a warp), 16 x 8 with AVX2, 8 x 8 with NEON.

        So the lanes that add to a tile's rows are never in two threads (``walks/slot_rows.py``).
        """
        if dr.backend_v(mi.Float) == dr.JitBackend.CUDA:
            return Blocks(4, 2, 4, 8, 1)
        return Blocks(4, 4, *LANES.get(llvm_packet(), LANES[16]), 4, adapts=True)


@dataclass(frozen=True)
class Cutoffs:
    """Where a walk may stop caring: |α| below ``alpha`` is ignored, and T never falls below ``transmittance``.

    ``SMOOTH`` removes both (kernels end where float32 does), for checks of derivatives by finite differences.
    """

    alpha: float = 1 / 255
    transmittance: float = 1e-4
    bound: float = 1.0  # tile lists leave out kernels below ``bound`` times ``alpha``; 1 is exact, more is an error

    @property
    def log2_range(self) -> float:
        """-log2 of the smallest kernel value that is ever looked at."""
        return -math.log2(self.alpha * self.bound) if self.alpha > 0 else 60.0


SMOOTH = Cutoffs(0.0, 0.0)
MAX_ALPHA = 0.99  # of a kernel, in pictures and along rays
MAX_T = 2.0**30  # a walk ends before; only a stack of negative lobes gets there, and float32 would end in ∞ and NaN


@dataclass
class Lanes:
    """All lanes of an image, the lanes of a tile side by side: where each is, and how large the image is."""

    tile: Any  # UInt, its tile
    x: Any  # UInt, first pixel of its block
    y: Any
    width: Any  # UInt, of the image: kernels read it, as those that held the number would be compiled for each size
    height: Any


@dataclass(frozen=True)
class Grid:
    """Tiles of one image size, and the lanes that walk them."""

    width: int
    height: int
    blocks: Blocks

    @property
    def tiles_x(self) -> int:
        return -(-self.width // self.blocks.tile_width)

    @property
    def tiles_y(self) -> int:
        return -(-self.height // self.blocks.tile_height)

    @property
    def n_tiles(self) -> int:
        return self.tiles_x * self.tiles_y

    @staticmethod
    def of(width: int, height: int, blocks: Blocks) -> Grid:
        """The grid of an image size, made once per variant (it holds device arrays)."""
        return _grid(width, height, blocks, mi.variant())

    @cached_property
    def lanes(self) -> Lanes:
        """Evaluated once per image size."""
        return self.lanes_of(range(self.tiles_y))

    def lanes_of(self, rows: range) -> Lanes:
        """Those of some tile rows, whose first tile is number 0."""
        UInt, b = array_types().UInt, self.blocks
        lane = dr.arange(UInt, len(rows) * self.tiles_x * b.lanes_per_tile)
        tile, lane = lane // b.lanes_per_tile, lane % b.lanes_per_tile
        tiles_x = constant(UInt, "tiles_x", self.tiles_x)
        tile_y = tile // tiles_x
        x = (tile - tile_y * tiles_x) * b.tile_width + (lane % b.lanes_x) * b.stride_x
        y = (tile_y + dr.opaque(UInt, rows.start)) * b.tile_height + (lane // b.lanes_x) * b.stride_y
        dr.make_opaque(tile, x, y)
        size = constant(UInt, "width", self.width), constant(UInt, "height", self.height)
        return Lanes(tile, x, y, *size)


@lru_cache(maxsize=64)
def _grid(width: int, height: int, blocks: Blocks, variant: str | None) -> Grid:
    return Grid(width, height, blocks)
