"""Blocks that lie behind the surface of a view, of which it says nothing: told by the farthest depth around them.

Farthest depths are kept for tiles of pixels of several sizes. A block is looked up where it covers 2 x 2 tiles at most.
"""

from __future__ import annotations

import numpy as np

from ..scene.cameras import Camera
from ..scene.splats import Array

TILE = 8  # pixels along the edge of the smallest
ROUNDING = 1e-5  # of a depth: the device computes in float32


def hidden(camera: Camera, depth: Array, middles: Array, radius: float, truncation: float) -> Array:
    """[B] bool, spheres of which no point is less than ``truncation`` behind the surface of its pixel.

    Args:
        depth: [H, W], z along the optical axis, 0 where there is no surface.
        middles: [B, 3] in camera space, where they may be in the picture.
        radius: of the spheres, world units, as ``truncation``.
    """
    x, y, z = middles.T
    first = z - radius  # [B] z of their nearest point
    found = first > truncation
    ends = []  # along each axis: first and last pixel [B], and its number of pixels
    for along, focal, centre, n in ((y, camera.fy, camera.cy, camera.height), (x, camera.fx, camera.cx, camera.width)):
        tangent = along / np.where(found, z, 1)
        half = focal * radius * np.hypot(1, tangent) / np.where(found, first, 1)
        middle = focal * tangent + centre
        ends.append([np.clip(np.floor(end), 0, n - 1).astype(np.int64) for end in (middle - half, middle + half)])
    width = np.maximum(ends[0][1] - ends[0][0], ends[1][1] - ends[1][0]) + 1  # [B] pixels along the longer side
    level = np.ceil(np.log2(np.maximum(width / TILE, 1))).astype(int)  # [B] of the smallest tiles that are as wide
    farthest = _farther(np.where(depth > 0, depth, np.inf), TILE)
    for k in range(int(level[found].max(initial=-1)) + 1):
        rows = np.flatnonzero(found & (level == k))
        (top, bottom), (left, right) = ([end[rows] // (TILE << k) for end in axis] for axis in ends)
        last = np.maximum.reduce([farthest[i, j] for i in (top, bottom) for j in (left, right)])
        found[rows] = first[rows] * (1 - ROUNDING) > last + truncation
        farthest = _farther(farthest, 2)
    return found


def _farther(depth: Array, factor: int) -> Array:
    """The greatest of each ``factor`` x ``factor`` entries; those beyond the border are none."""
    height, width = depth.shape
    padded = np.pad(depth, ((0, -height % factor), (0, -width % factor)))
    return padded.reshape(padded.shape[0] // factor, factor, padded.shape[1] // factor, factor).max(axis=(1, 3))
