"""Fewer primitives without a picture: near and alike ones become one, the cheapest pairs first.

The cost of a pair is what the mixture of both loses where it becomes a single Gaussian of its moments, an upper bound
on the Kullback-Leibler divergence (Runnalls 2007, Eq. 16), with the colour as further dimensions of the space whose
variance is σ² everywhere:

    cost = ½ (w log|Σ| - w₁ log|Σ₁| - w₂ log|Σ₂|) + ½ (w₁ w₂ / w) |c₁ - c₂|² / (4π σ²)

|c|² / 4π is the mean square of a view-dependent colour over all directions (the spherical harmonics are orthonormal).
Σ has the square of a resolution added: differences too small to be seen cost nothing.

Rounds: each finds the nearest neighbours of every cluster, and merges those pairs of which each is the cheapest
partner of the other, the cheapest of them first. A round merges a share alone, so that what has grown is weighed again.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..scene.splats import Array, Splats
from .moments import Clusters, merged

NEIGHBOURS = 16
SHARE = 0.1  # of the clusters that a round takes away
COLOR_DEVIATION = 0.1  # σ
ROWS = 32_768  # clusters whose pairs are weighed at a time, which bounds the memory


def merge(splats: Splats, target: int, resolution: float, weights: Array | None = None) -> Splats:
    """``target`` Gaussians of the moments of what was near each other.

    Args:
        splats: finite parameters; DoG is left out of account.
        target: number of primitives, at least 1; a smaller model stays as it is.
        resolution: world units, below which shapes are alike.
        weights: [N] > 0, how much of each primitive is seen; None: its opacity over its area.
    """
    if target < 1:
        raise ValueError(f"merge: the target is {target}, expected at least 1")
    clusters = Clusters.of(splats, weights)
    if len(clusters) <= target:
        return splats
    while (excess := len(clusters) - target) > 0:
        clusters = _round(clusters, min(excess, max(1, int(SHARE * len(clusters)))), resolution)
    return clusters.splats()


def _round(clusters: Clusters, most: int, resolution: float) -> Clusters:
    first, second, costs = candidate_pairs(clusters, resolution)
    chosen = mutual(first, second, costs, len(clusters))
    chosen = chosen[np.argsort(costs[chosen], kind="stable")[:most]]
    first, second = first[chosen], second[chosen]
    alone = np.ones(len(clusters), bool)
    alone[first] = alone[second] = False
    return clusters.select(alone).joined(merged(clusters.select(first), clusters.select(second)))


def candidate_pairs(clusters: Clusters, resolution: float, neighbours: int = NEIGHBOURS) -> tuple[Array, Array, Array]:
    """Each cluster with its nearest ``neighbours``: first and second [P], first < second, and their costs [P]."""
    n = len(clusters)
    count = min(neighbours, n - 1)
    # an index is among its own neighbours, but at one place with many others it need not be
    near = cKDTree(clusters.means).query(clusters.means, count + 1)[1].reshape(n, -1)  # [N, count + 1]
    first, second = np.repeat(np.arange(n), count + 1), near.ravel()
    ends = np.stack([np.minimum(first, second), np.maximum(first, second)], axis=1)
    ends = np.unique(ends[first != second], axis=0)  # [P, 2]
    log_sizes = _log_determinants(clusters.covariances, resolution)
    costs = [pair_costs(clusters, log_sizes, ends[k : k + ROWS], resolution) for k in range(0, len(ends), ROWS)]
    return ends[:, 0], ends[:, 1], np.concatenate(costs)


def pair_costs(clusters: Clusters, log_sizes: Array, ends: Array, resolution: float) -> Array:
    """[P] of the pairs ``ends`` [P, 2]; ``log_sizes`` [N] are log|Σ| of the clusters."""
    first, second = (clusters.select(ends[:, k]) for k in range(2))
    both = merged(first, second)
    w1, w2 = first.weights, second.weights
    sizes = w1 * log_sizes[ends[:, 0]] + w2 * log_sizes[ends[:, 1]]
    shape = both.weights * _log_determinants(both.covariances, resolution) - sizes
    color = ((first.sh_coeffs - second.sh_coeffs) ** 2).sum(axis=(1, 2)) / (4 * np.pi * COLOR_DEVIATION**2)
    return 0.5 * (shape + w1 * w2 / both.weights * color)


def mutual(first: Array, second: Array, costs: Array, n: int) -> Array:
    """Indices of the pairs that are the cheapest of both their ends; of equals the one listed first."""
    ranks = np.empty(len(costs), np.int64)
    ranks[np.argsort(costs, kind="stable")] = np.arange(len(costs))
    best = np.full(n, len(costs))
    for ends in (first, second):
        np.minimum.at(best, ends, ranks)
    return np.flatnonzero((best[first] == ranks) & (best[second] == ranks))


def _log_determinants(covariances: Array, resolution: float) -> Array:
    (a, d, e), (_, b, f), (_, _, c) = np.moveaxis(covariances + resolution**2 * np.eye(3), 0, 2)
    determinant = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e)
    return np.log(np.maximum(determinant, resolution**6))
