"""Vector quantisation: a few representative values for many, for the formats that store indices into a table."""

from __future__ import annotations

import heapq

import numpy as np

from ..scene.splats import Array

CODES = 256  # of a codebook: a byte
LLOYD_STEPS = 30
PRODUCTS = 1 << 21  # of vectors and entries at a time: they stay in the caches
BINS = 128  # of the first guess: few, so that each holds enough values for a density


def codebook(values: Array) -> Array:
    """``CODES`` increasing numbers float32 [CODES] that come near to all ``values``, in the mean of squares.

    Lloyd's algorithm in one dimension, where cells are intervals: sums over them are differences of running sums.
    """
    ordered = np.sort(np.asarray(values, np.float64).ravel())
    if not len(ordered):
        return np.zeros(CODES, np.float32)
    distinct = np.unique(ordered)
    if len(distinct) <= CODES:
        return np.pad(distinct, (0, CODES - len(distinct)), mode="edge").astype(np.float32)
    running = np.concatenate([[0.0], np.cumsum(ordered)])
    counts, edges = np.histogram(ordered, BINS)
    density = np.cumsum(np.cbrt(counts))  # the best centres lie as dense as the cube root of what they stand for
    centres = np.interp((np.arange(CODES) + 0.5) / CODES * density[-1], density, edges[1:])
    for _ in range(LLOYD_STEPS):
        edges = np.searchsorted(ordered, (centres[1:] + centres[:-1]) / 2)
        edges = np.concatenate([[0], edges, [len(ordered)]])
        counts = np.diff(edges)
        means = np.diff(running[edges]) / np.maximum(counts, 1)
        centres = np.sort(np.where(counts > 0, means, centres))
    return centres.astype(np.float32)


def nearest(table: Array, values: Array) -> Array:
    """Index of the entry of an increasing ``table`` nearest to each value; shape of ``values``."""
    return np.searchsorted(table[1:] / 2 + table[:-1] / 2, values)  # a sum may be more than float32 can say


def palette(vectors: Array, size: int, weights: Array | None = None) -> tuple[Array, Array]:
    """Labels [N] and at most ``size`` centroids float32 [P, D] of vectors [N, D].

    Args:
        weights: [N] of the vectors in sums of squared errors, positive; None: all alike.

    Always the cell with the largest sum of squared errors is cut in two, across the axis along which it is widest, at
    its mean (a tree-structured vector quantiser). It is deterministic, and its work is N D log P.
    """
    values = np.asarray(vectors, np.float64)
    w = np.ones(len(values)) if weights is None else np.asarray(weights, np.float64)  # [N]
    labels = np.zeros(len(values), np.int64)
    cells: list[tuple[float, int, int, Array]] = []  # (- squared error, label, axis, rows)

    def mean(rows: Array) -> Array:
        return (w[rows, None] * values[rows]).sum(axis=0) / w[rows].sum()  # [D]

    def put(label: int, rows: Array) -> None:
        inside, weight = values[rows], w[rows, None]
        errors = (weight * np.square(inside - mean(rows))).sum(axis=0)  # [D]
        labels[rows] = label
        heapq.heappush(cells, (-float(errors.sum()), label, int(errors.argmax()), rows))

    if len(values):
        put(0, np.arange(len(values)))
    while cells and len(cells) < size and cells[0][0] < 0:
        _, label, axis, rows = heapq.heappop(cells)
        low = values[rows, axis] < mean(rows)[axis]
        if low.all() or not low.any():  # rounding: all alike along every axis
            heapq.heappush(cells, (0.0, label, axis, rows))
            continue
        put(label, rows[low])
        put(len(cells), rows[~low])
    total = np.bincount(labels, w, len(cells))
    sums = np.stack([np.bincount(labels, w * column, len(cells)) for column in values.T], axis=1)  # [P, D]
    return labels, (sums / np.where(total > 0, total, 1)[:, None]).astype(np.float32)


def lloyd(vectors: Array, entries: Array, weights: Array, rounds: int) -> tuple[Array, Array]:
    """Labels [N] of the nearest entries and the entries float32 [P, D], after so many rounds of Lloyd's algorithm.

    Args:
        vectors, weights: as ``palette`` takes them.
        entries: [P, D] to begin with, as ``palette`` returns them. What is nearest to no vector stays where it is.
    """
    for _ in range(rounds):
        entries = centred(vectors, nearest_entries(vectors, entries), entries, weights)
    return nearest_entries(vectors, entries), entries


def centred(vectors: Array, labels: Array, entries: Array, weights: Array) -> Array:
    """The entries float32 [P, D] in the weighted middle of the vectors [N, D] with their label; others stay."""
    total = np.bincount(labels, weights, len(entries))[:, None]  # [P, 1]
    sums = np.stack([np.bincount(labels, weights * column, len(entries)) for column in vectors.T], axis=1)
    return np.where(total > 0, sums / np.where(total > 0, total, 1), entries).astype(np.float32)


def nearest_entries(vectors: Array, entries: Array) -> Array:
    """[N] index of the entry [P, D] nearest to each vector [N, D].

    |v - e|² is |v|² - 2 (v·e - |e|²/2). What is in brackets is one product of matrices, largest where e is nearest.
    """
    half = np.square(entries).sum(axis=1, keepdims=True) / 2  # [P, 1]
    table = np.ascontiguousarray(np.concatenate([entries, -half], axis=1, dtype=np.float32).T)  # [D + 1, P]
    rows = max(1, PRODUCTS // len(entries))
    blocks = (vectors[start : start + rows] for start in range(0, len(vectors), rows))
    extended = (np.pad(block, ((0, 0), (0, 1)), constant_values=1).astype(np.float32) for block in blocks)
    return np.concatenate([(block @ table).argmax(axis=1) for block in extended])
