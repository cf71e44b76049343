"""Vector quantisation: a few representative values for many, for the formats that store indices into a table."""

from __future__ import annotations

import heapq

import numpy as np

from ..scene.splats import Array

LLOYD_STEPS = 30
BINS = 128  # of the first guess: few, so that each holds enough values for a density


def codebook(values: Array, size: int = 256) -> Array:
    """``size`` increasing numbers float32 [size] that come near to all ``values``, in the mean of squares.

    Lloyd's algorithm in one dimension, where cells are intervals: sums over them are differences of running sums.
    """
    ordered = np.sort(np.asarray(values, np.float64).ravel())
    if not len(ordered):
        return np.zeros(size, np.float32)
    distinct = np.unique(ordered)
    if len(distinct) <= size:
        return np.pad(distinct, (0, size - len(distinct)), mode="edge").astype(np.float32)
    running = np.concatenate([[0.0], np.cumsum(ordered)])
    counts, edges = np.histogram(ordered, BINS)
    density = np.cumsum(np.cbrt(counts))  # the best centres lie as dense as the cube root of what they stand for
    centres = np.interp((np.arange(size) + 0.5) / size * density[-1], density, edges[1:])
    for _ in range(LLOYD_STEPS):
        edges = np.searchsorted(ordered, (centres[1:] + centres[:-1]) / 2)
        edges = np.concatenate([[0], edges, [len(ordered)]])
        counts = np.diff(edges)
        means = np.diff(running[edges]) / np.maximum(counts, 1)
        centres = np.sort(np.where(counts > 0, means, centres))
    return centres.astype(np.float32)


def nearest(table: Array, values: Array) -> Array:
    """Index of the entry of an increasing ``table`` nearest to each value; shape of ``values``."""
    return np.searchsorted((table[1:] + table[:-1]) / 2, values)


def palette(vectors: Array, size: int) -> tuple[Array, Array]:
    """Labels [N] and at most ``size`` centroids float32 [P, D] of vectors [N, D].

    Always the cell with the largest sum of squared errors is cut in two, across the axis along which it is widest, at
    its mean (a tree-structured vector quantiser). It is deterministic, and its work is N D log P.
    """
    values = np.asarray(vectors, np.float64)
    labels = np.zeros(len(values), np.int64)
    cells: list[tuple[float, int, int, Array]] = []  # (- squared error, label, axis, rows)

    def put(label: int, rows: Array) -> None:
        inside = values[rows]
        errors = np.square(inside - inside.mean(axis=0)).sum(axis=0)  # [D]
        labels[rows] = label
        heapq.heappush(cells, (-float(errors.sum()), label, int(errors.argmax()), rows))

    if len(values):
        put(0, np.arange(len(values)))
    while cells and len(cells) < size and cells[0][0] < 0:
        _, label, axis, rows = heapq.heappop(cells)
        low = values[rows, axis] < values[rows, axis].mean()
        if not low.any():  # rounding: all alike along every axis
            heapq.heappush(cells, (0.0, label, axis, rows))
            continue
        put(label, rows[low])
        put(len(cells), rows[~low])
    counts = np.bincount(labels, minlength=len(cells))
    sums = np.stack([np.bincount(labels, column, len(cells)) for column in values.T], axis=1)  # [P, D]
    return labels, (sums / np.maximum(counts, 1)[:, None]).astype(np.float32)
