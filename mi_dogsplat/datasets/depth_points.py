"""Points of a scene from depth maps, at which a training starts besides those of structure from motion, or alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

from ..scene.cameras import Camera

MOST = 100_000  # points: as many as structure from motion finds in some hundred photographs
TAKEN = 5  # times as many are taken, before they become one for each voxel
STEADY = 0.05  # relative difference of depths, above which they are of two surfaces
JUDGES, ENOUGH = 24, 512  # views whose maps judge the points of all others, and pixels of a side that they have for it
HALVINGS = 16  # of the size of a voxel, until it is found
FINEST = 2**20  # voxels along the longest side of what the points fill


def depth_points(
    views: Iterable[tuple[Camera, np.ndarray, np.ndarray]], n_views: int, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """(points [P, 3] float32 in world space, colors [P, 3] float32 in 0..1), at most ``MOST``, evenly spread,
    without those between two surfaces, and those that other views see through.

    Args:
        views: a camera, the depths [H, W] along its axis, of any size, 0 where nothing is known, and the sRGB of its
            image [H', W', 3 or more] in 0..1, of any size.
        n_views: how many there are.
        seed: of the choice of pixels.
    """
    points, colors, judges = [np.zeros((0, 3))], [np.zeros((0, 3))], []
    rng = np.random.default_rng(seed)
    for number, (camera, depth, image) in enumerate(views):
        if number % -(-n_views // JUDGES) == 0:
            coarser = -(-max(depth.shape) // ENOUGH)
            judges.append((camera, depth[coarser // 2 :: coarser, coarser // 2 :: coarser]))
        rows, columns = np.nonzero(steady(depth))
        taken = rng.permutation(len(rows))[: TAKEN * MOST // n_views]
        rows, columns = rows[taken], columns[taken]
        size = np.array([depth.shape[1], depth.shape[0]])
        shares = (np.stack([columns, rows], axis=1) + 0.5) / size  # [T, 2] of the sides of the image
        points.append(camera.unproject(shares * (camera.width, camera.height), depth[rows, columns]))
        x, y = (shares * (image.shape[1], image.shape[0])).astype(np.intp).T
        colors.append(image[y, x, :3])
    all_points, all_colors = np.concatenate(points), np.concatenate(colors)
    kept = ~seen_through(all_points, judges)
    places, shown = thinned(all_points[kept], all_colors[kept], MOST)
    return places.astype(np.float32), shown.astype(np.float32)


def steady(depth: np.ndarray) -> np.ndarray:
    """Which pixels of a depth map [H, W] are known and on one surface with the known ones beside them: sensors and
    networks put some between two surfaces, where none is."""
    known = depth > 0
    kept = known.copy()
    for axis in (0, 1):
        a, b = (np.take(depth, range(start, depth.shape[axis] - 1 + start), axis) for start in (0, 1))
        jump = (np.abs(a - b) > STEADY * np.minimum(a, b)) & (a > 0) & (b > 0)
        before, after = [(0, 0), (0, 0)], [(0, 0), (0, 0)]
        before[axis], after[axis] = (0, 1), (1, 0)
        kept &= ~(np.pad(jump, before) | np.pad(jump, after))
    return kept


def seen_through(points: np.ndarray, judges: Sequence[tuple[Camera, np.ndarray]]) -> np.ndarray:
    """Which points [P, 3] are where more of the maps see something behind them than see just them: depth maps of
    cameras, of any size, 0 where they know nothing. What lies behind something is not seen, and no map denies it."""
    votes = np.zeros(len(points), int)
    for camera, depth in judges:
        pixels, z = camera.project(points)
        with np.errstate(invalid="ignore", over="ignore"):
            shares = pixels / (camera.width, camera.height)  # [P, 2] of the sides of the image
            inside = np.flatnonzero((z > 0) & ((shares >= 0) & (shares < 1)).all(axis=1))
        x, y = (shares[inside] * (depth.shape[1], depth.shape[0])).astype(np.intp).T
        known = depth[y, x] > 0
        inside, ratio = inside[known], z[inside[known]] / depth[y, x][known]
        votes[inside] += np.where(ratio < 1 - STEADY, -1, ratio <= 1 + STEADY)
    return votes < 0


def far_from(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Which points [P, 3] are farther from each of the others [Q, 3] than from one another, by the median."""
    if len(points) < 2 or not len(others):
        return np.ones(len(points), bool)
    spacing = np.median(cKDTree(points).query(points, k=2)[0][:, 1])
    return cKDTree(others).query(points)[0] > spacing


def thinned(points: np.ndarray, colors: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """The means of points [P, 3] and of their colours [P, 3] in the cells of a grid, so fine that at most ``most`` hold
    any; all of them where there are no more."""
    if len(points) <= most:
        return points, colors
    offsets = points - points.min(axis=0)
    extent = float(offsets.max()) or 1.0
    fine, coarse = extent / FINEST, extent
    for _ in range(HALVINGS):
        middle = (fine + coarse) / 2
        fits = len(np.unique(_cells(offsets, middle))) <= most
        fine, coarse = (fine, middle) if fits else (middle, coarse)
    _, cell, count = np.unique(_cells(offsets, coarse), return_inverse=True, return_counts=True)
    means = [
        np.stack([np.bincount(cell, column, len(count)) for column in values.T], axis=1) / count[:, None]
        for values in (points, colors)
    ]
    return means[0], means[1]


def _cells(offsets: np.ndarray, size: float) -> np.ndarray:
    """The number [P] of the cell of each point."""
    x, y, z = np.floor(offsets / size).astype(np.int64).T
    return (x * (2 * FINEST) + y) * (2 * FINEST) + z
