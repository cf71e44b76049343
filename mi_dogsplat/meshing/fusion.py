"""Depth pictures to a signed distance: truncated, and the mean of all views (Curless and Levoy 1996; KinectFusion).

A voxel at depth z, in the pixel of a view that sees a surface at depth d, has the distance d - z, positive in front of
it. It counts in units of the truncation, and up to 1. A voxel farther behind the surface than that is hidden: the view
says nothing of it. A pixel that sees no surface sees free space all along: the distance 1.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from ..scene.cameras import Camera
from ..scene.splats import Array
from .blocks import SIDE, VOXELS, Blocks
from .occlusion import hidden
from .pixels import pixel_of

BITS = SIDE.bit_length() - 1  # of a coordinate within a block


class Fusion:
    """Sums over views of the voxels of blocks, on the device."""

    def __init__(self, blocks: Blocks, truncation: float):
        """``truncation``: world units."""
        self.blocks, self.truncation = blocks, truncation
        n = len(blocks.keys) * VOXELS
        self._sums, self._counts = dr.zeros(mi.Float, n), dr.zeros(mi.Float, n)
        dr.make_opaque(self._sums, self._counts)

    def add(self, camera: Camera, depth: Array, near: float) -> None:
        """A view: its depth picture [H, W], z along the optical axis, 0 where it sees no surface."""
        rows = self.blocks.seen_by(camera, near)
        rotation = camera.w2c[:3, :3]
        corners = self.blocks.corners[rows] @ rotation.T + camera.w2c[:3, 3]  # in camera space: far origins are gone
        to_middle = self.blocks.voxel * (SIDE - 1) / 2 * rotation.sum(axis=1)
        told = ~hidden(camera, depth, corners + to_middle, self.blocks.radius, self.truncation)
        rows, corners = rows[told], corners[told]
        if not len(rows):
            return
        numbers = [camera.fx, camera.fy, camera.cx, camera.cy, near, 1 / self.truncation]
        steps = (self.blocks.voxel * rotation).ravel()  # a step along x, y and z are its columns
        _add(
            self._sums, self._counts, mi.UInt32(rows.astype(np.uint32)),
            [mi.Float(np.ascontiguousarray(column, np.float32)) for column in corners.T],
            [dr.opaque(mi.Float, float(number)) for number in (*numbers, *steps)],
            mi.Float(np.ascontiguousarray(depth, np.float32).ravel()),
            [dr.opaque(mi.UInt32, side) for side in depth.shape],
        )  # fmt: skip

    def distances(self, least: int = 1) -> Array:
        """[B, SIDE, SIDE, SIDE] mean distance in units of the truncation; NaN where fewer views told it than ``least``,
        which is 1 or more."""
        shape = len(self.blocks.keys), SIDE, SIDE, SIDE
        if not shape[0]:  # Dr.Jit compares no empty array
            return np.zeros(shape, np.float32)
        told = self._counts >= dr.opaque(mi.Float, least)
        return dr.select(told, self._sums / self._counts, dr.nan).numpy().reshape(shape)


def _add(sums, counts, rows, corners: list, numbers: list, depth, size: list) -> None:
    """A lane for each voxel of the blocks ``rows``, whose first voxels are at ``corners`` in camera space."""
    lane = dr.arange(mi.UInt32, dr.width(rows) * VOXELS)
    row, within = lane // VOXELS, lane % VOXELS
    steps = [mi.Float((within >> shift) & (SIDE - 1)) for shift in (2 * BITS, BITS, 0)]
    *lens, near, per_truncation = numbers[:6]
    axes = numbers[6:]
    x, y, z = (
        dr.gather(mi.Float, corner, row) + sum(step * along for step, along in zip(steps, axes[3 * k :], strict=False))
        for k, corner in enumerate(corners)
    )
    inside, pixel, _ = pixel_of((x, y, z), lens, near, size)
    there = dr.gather(mi.Float, depth, pixel, inside)
    distance = dr.select(there > 0, (there - z) * per_truncation, 1)
    told = inside & (distance >= -1)
    place = dr.gather(mi.UInt32, rows, row) * VOXELS + within
    for sum_, value in ((sums, dr.minimum(distance, 1)), (counts, mi.Float(1))):
        dr.scatter(sum_, dr.gather(mi.Float, sum_, place, told) + value, place, told, mode=dr.ReduceMode.NoConflicts)
    dr.eval(sums, counts)
