"""How the image is cut: tiles of 16 x 16 pixels, shared by a packet of lanes that own a block of pixels each.

This is all that depends on the backend. A block is unrolled in the compositing kernel, so every parameter that a lane
loads serves the whole block, and every lane of a packet walks the same list of primitives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import drjit as dr
import mitsuba as mi

TILE_SIZE = 16


@dataclass(frozen=True)
class Blocks:
    """Block of pixels per lane; a tile is ``lanes_x * lanes_y`` lanes. ``unroll``: primitives per loop iteration."""

    width: int
    height: int
    unroll: int

    @property
    def lanes_x(self) -> int:
        return TILE_SIZE // self.width

    @property
    def lanes(self) -> int:
        return self.lanes_x * (TILE_SIZE // self.height)

    @staticmethod
    def of_backend() -> Blocks:
        """16 lanes (one AVX-512 packet) of 8 x 2 on the CPU, one warp of 4 x 2 on CUDA."""
        return Blocks(4, 2, 1) if dr.backend_v(mi.Float) == dr.JitBackend.CUDA else Blocks(8, 2, 4)


@dataclass(frozen=True)
class Cutoffs:
    """Where a walk may stop caring: |α| below ``alpha`` is ignored, and T never falls below ``transmittance``.

    ``SMOOTH`` removes both (kernels end where float32 does), for checks of derivatives by finite differences.
    """

    alpha: float = 1 / 255
    transmittance: float = 1e-4

    @property
    def log2_range(self) -> float:
        """-log2 of the smallest kernel value that is ever looked at."""
        return -math.log2(self.alpha) if self.alpha > 0 else 60.0


SMOOTH = Cutoffs(0.0, 0.0)


@dataclass(frozen=True)
class Grid:
    """Tiles of one image size, and the lanes that walk them."""

    width: int
    height: int
    blocks: Blocks

    @property
    def tiles_x(self) -> int:
        return -(-self.width // TILE_SIZE)

    @property
    def tiles_y(self) -> int:
        return -(-self.height // TILE_SIZE)

    @property
    def n_tiles(self) -> int:
        return self.tiles_x * self.tiles_y

    @cached_property
    def lanes(self) -> tuple:
        """(tile of the lane, x and y of its block's first pixel), evaluated once per image size."""
        UInt = dr.detached_t(mi.UInt32)
        b = self.blocks
        lane = dr.arange(UInt, self.n_tiles * b.lanes)
        tile, lane = lane // b.lanes, lane % b.lanes
        tile_y = tile // self.tiles_x
        x = (tile - tile_y * self.tiles_x) * TILE_SIZE + (lane % b.lanes_x) * b.width
        y = tile_y * TILE_SIZE + (lane // b.lanes_x) * b.height
        dr.make_opaque(tile, x, y)
        return tile, x, y
