"""How points moved: the linear transforms that rows of positions went through, found from before and after."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FEWEST = 4  # points that a turn is read from
FEWEST_STRETCHED = 8  # points that any other linear transform is read from: four fit one whatever they do
SMALLEST_PIECE = 64  # rows that are halved no further
LONGEST_RUN = 8 * SMALLEST_PIECE  # rows that may be of small objects alone
TOLERANCE = 1e-5  # of the extent: what Blender's float32 leaves
ROUNDING = 4 * np.finfo(np.float32).eps  # of the coordinates: moved there and back

Rows = NDArray[np.intp]


def motions(before: NDArray, after: NDArray) -> list[tuple[Rows, NDArray[np.float64]]]:
    """(rows, [4, 4]) for each group of rows of [N, 3] that moved as one.

    All rows at once, those that moved, or halves of these, as joined objects leave them. Rows that moved by themselves,
    and those that are not finite, are in no group. What stood still says nothing on how the others moved: a splat far
    away would excuse everything.
    """
    before, after = before.astype(np.float64), after.astype(np.float64)
    known = np.flatnonzero(np.isfinite(before).all(axis=1) & np.isfinite(after).all(axis=1))
    if len(known) < len(before):
        return [(known[rows], matrix) for rows, matrix in motions(before[known], after[known])]
    everything = np.arange(len(before))
    moved = np.flatnonzero((before != after).any(axis=1))
    if not len(moved):
        return []
    if is_rounding(before, after):
        return [(everything, np.eye(4))]
    if (matrix := motion(before[moved], after[moved])) is not None:
        whole = _misses(before, after, matrix).max() <= TOLERANCE * _extent(after)
        return [(everything if whole else moved, matrix)]
    groups: list[tuple[Rows, NDArray[np.float64]]] = []
    alone, found = moved, _halved(before, after, moved) or _in_short_runs(before, after, moved)
    while found:
        groups += found
        alone = np.setdiff1d(alone, np.concatenate([rows for rows, _ in found]))
        for rows, matrix in found:  # those beside a border between two objects
            near = alone[_misses(before[alone], after[alone], matrix) <= TOLERANCE * _extent(after[rows])]
            groups.append((near, matrix))
            alone = np.setdiff1d(alone, near)
        found = _in_short_runs(before, after, alone)
    return [(rows, matrix) for rows, matrix in groups if len(rows)]


def motion(before: NDArray, after: NDArray) -> NDArray[np.float64] | None:
    """[4, 4] that takes points [N, 3] to others, a similarity where one does; None where no linear transform does."""
    found = similarity(before, after)
    return found if found is not None else affinity(before, after)


def affinity(before: NDArray, after: NDArray) -> NDArray[np.float64] | None:
    """[4, 4] of any linear transform, or None: also where it flattens, and for points of a plane, which tell none."""
    if len(before) < FEWEST_STRETCHED:
        return None
    low, high = before.mean(axis=0), after.mean(axis=0)
    solved, _, rank, _ = np.linalg.lstsq(before - low, after - high, rcond=1e-6)
    sizes = np.linalg.svd(solved, compute_uv=False)
    if rank < 3 or not sizes[-1] > 1e-6 * sizes[0]:
        return None
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = solved.T, high - solved.T @ low
    return matrix if _misses(before, after, matrix).max() <= TOLERANCE * _extent(after) else None


def similarity(before: NDArray, after: NDArray) -> NDArray[np.float64] | None:
    """[4, 4] that takes points [N, 3] to others (Umeyama 1991), or None where no turn, scale and shift does.

    Fewer than four points, and points on a line, tell no turn.
    """
    if len(before) < FEWEST:
        return None
    low, high = before.mean(axis=0), after.mean(axis=0)
    centered, target = before - low, after - high
    u, sizes, vt = np.linalg.svd(target.T @ centered)
    if sizes[1] <= 1e-12 * max(sizes[0], 1e-300):
        return None
    signs = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    scale = (sizes * signs).sum() / (centered**2).sum()
    if not scale > 0:
        return None
    matrix = np.eye(4)
    matrix[:3, :3] = scale * (u * signs) @ vt
    matrix[:3, 3] = high - matrix[:3, :3] @ low
    return matrix if _misses(before, after, matrix).max() <= TOLERANCE * _extent(after) else None


def is_rounding(before: NDArray, after: NDArray) -> bool:
    """Whether points only lost their last bits, those of their own coordinates or of most others."""
    sizes = np.abs(before).max(axis=1)
    return bool((np.abs(before - after).max(axis=1) <= ROUNDING * np.maximum(sizes, np.median(sizes))).all())


def is_shift(matrix: NDArray) -> bool:
    """Whether a transform neither turns nor scales."""
    return bool(np.abs(matrix[:3, :3] - np.eye(3)).max() < TOLERANCE)


def _halved(before: NDArray, after: NDArray, rows: Rows) -> list[tuple[Rows, NDArray[np.float64]]]:
    matrix = motion(before[rows], after[rows])
    if matrix is not None:
        return [(rows, matrix)]
    if len(rows) < 2 * SMALLEST_PIECE:
        return []
    middle = len(rows) // 2
    return _halved(before, after, rows[:middle]) + _halved(before, after, rows[middle:])


def _in_short_runs(before: NDArray, after: NDArray, rows: Rows) -> list[tuple[Rows, NDArray[np.float64]]]:
    """Groups among rows that follow each other, of objects too small for a half of their own: by their first rows.

    Long runs hold no object: they were edited splat by splat, and looking again would only take time.
    """
    found = []
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
        if FEWEST <= len(run) < LONGEST_RUN:
            found += _halved(before, after, run) or _halved(before, after, run[:FEWEST_STRETCHED])
    return found


def _misses(before: NDArray, after: NDArray, matrix: NDArray) -> NDArray[np.float64]:
    return np.abs(before @ matrix[:3, :3].T + matrix[:3, 3] - after).max(axis=1, initial=0.0)


def _extent(points: NDArray) -> float:
    """Half the diagonal, or what float32 can tell apart at that distance from the origin."""
    return float(np.linalg.norm(np.ptp(points, axis=0)) / 2 + 0.1 * np.abs(points).max())
