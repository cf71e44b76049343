"""Where there is a surface: blocks of voxels, of which only those near to it exist (Nießner et al. 2013).

A voxel is a point of a grid with integer coordinates: ``centre`` plus ``voxel`` times these. A block has SIDE³ of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..scene.cameras import Camera
from ..scene.splats import Array

SIDE = 8  # voxels along the edge of a block
VOXELS = SIDE**3  # of a block
BITS = 21  # of a coordinate in a key
HALF = 1 << (BITS - 1)  # coordinates of cells and blocks are below it in size


@dataclass(frozen=True)
class Blocks:
    """B blocks of a grid, sorted by their keys."""

    centre: Array
    """[3] world position of the voxel 0, 0, 0"""
    voxel: float
    """distance of neighbours, world units"""
    keys: Array
    """[B] int64, ascending"""

    @property
    def places(self) -> Array:
        """[B, 3] coordinates in blocks."""
        return places_of(self.keys)

    @property
    def corners(self) -> Array:
        """[B, 3] world position of the first voxel of each block, float64."""
        return self.centre + self.voxel * SIDE * self.places

    @property
    def radius(self) -> float:
        """Of the sphere around the voxels of a block, world units."""
        return self.voxel * (SIDE - 1) * math.sqrt(3) / 2

    def rows(self, places: Array) -> Array:
        """[P] row of each block at ``places`` [P, 3], -1 where there is none."""
        wanted = keys_of(places)
        found = np.searchsorted(self.keys, wanted)
        there = found < len(self.keys)
        there[there] = self.keys[found[there]] == wanted[there]
        return np.where(there, found, -1)

    def seen_by(self, camera: Camera, near: float) -> Array:
        """[b] rows of the blocks that may be in the picture of a camera, by the sphere around each."""
        radius = self.radius
        middle = self.corners + self.voxel * (SIDE - 1) / 2
        x, y, z = (middle @ camera.w2c[:3, :3].T + camera.w2c[:3, 3]).T
        seen = z + radius > near
        for along, focal, first, end in (
            (x, camera.fx, -camera.cx, camera.width - camera.cx), (y, camera.fy, -camera.cy, camera.height - camera.cy)
        ):  # fmt: skip
            for sign, edge in ((1, end), (-1, first)):  # planes through the camera and an edge of the picture
                tangent = edge / focal
                seen &= sign * (along - tangent * z) <= radius * np.hypot(1, tangent)
        return np.flatnonzero(seen)


class BlockFinder:
    """Collects the points of surfaces, and says which blocks are within ``reach`` of one."""

    def __init__(self, centre: Array, voxel: float, reach: float):
        self.centre, self.voxel, self.reach = centre, voxel, reach
        self._cells = np.zeros(0, np.int64)  # keys of cubes of the side ``reach`` that hold a point
        self._later = [self._cells]  # of points that came since then

    def add(self, points: Array) -> None:
        """Points [P, 3] of a surface."""
        cells = np.floor((points - self.centre) / self.reach).astype(np.int64)
        self._later.append(np.unique(keys_of(cells)))
        if sum(map(len, self._later)) > len(self._cells):  # or each point would be sorted once for each view
            self._merge()

    def _merge(self) -> None:
        self._cells = np.unique(np.concatenate([self._cells, *self._later]))
        self._later = []

    @property
    def at_least(self) -> int:
        """How many blocks there will be at least."""
        return len(self._cells) // max(1, math.ceil(SIDE * self.voxel / self.reach)) ** 3

    def coarser(self, factor: int) -> BlockFinder:
        """What finds blocks near the same points, with ``voxel`` and ``reach`` so many times as large."""
        self._merge()
        found = BlockFinder(self.centre, factor * self.voxel, factor * self.reach)
        found._cells = np.unique(keys_of(places_of(self._cells) // factor))
        return found

    def blocks(self) -> Blocks:
        """All of whose voxels some may be within reach of a point."""
        self._merge()
        keys = self._cells
        for step in (1, 1 << BITS, 1 << 2 * BITS):  # the neighbours along one axis after the other
            keys = np.unique(np.concatenate([keys - step, keys, keys + step]))
        near = places_of(keys)  # [C, 3]
        blocks_of_cell = self.reach / (SIDE * self.voxel)  # along an edge
        n = math.ceil(blocks_of_cell)  # points of a cell that are a block apart, or less, are in all of its blocks
        keys = [
            np.unique(keys_of(np.floor((near + np.array(steps) / n) * blocks_of_cell).astype(np.int64)))
            for steps in np.ndindex(n + 1, n + 1, n + 1)
        ]
        return Blocks(self.centre, self.voxel, np.unique(np.concatenate(keys)))


def keys_of(places: Array) -> Array:
    """[P] int64, one number for three coordinates [P, 3]; their order is that of the first, then the second."""
    x, y, z = (np.asarray(places, np.int64) + HALF).T
    return (x << 2 * BITS) | (y << BITS) | z


def places_of(keys: Array) -> Array:
    """[P, 3] coordinates of ``keys_of``."""
    mask = (1 << BITS) - 1
    return np.stack([keys >> 2 * BITS, (keys >> BITS) & mask, keys & mask], axis=-1) - HALF
