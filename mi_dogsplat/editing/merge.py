"""Fewer primitives without a picture: near and alike ones become one, the cheapest pairs first.

The cost of a pair is what the mixture of both loses where it becomes a single Gaussian of its moments, an upper bound
on the Kullback-Leibler divergence (Runnalls 2007, Eq. 16), with the colour as further dimensions of the space whose
variance is σ² everywhere:

    cost = ½ (w log|Σ| - w₁ log|Σ₁| - w₂ log|Σ₂|) + ½ (w₁ w₂ / w) |c₁ - c₂|² / (4π σ²)

|c|² / 4π is the mean square of a view-dependent colour over all directions (the spherical harmonics are orthonormal).
Σ has the square of a resolution added: differences too small to be seen cost nothing.

Rounds: each finds the nearest neighbours of every cluster, and merges pairs from the cheapest on, each cluster once. A
round takes away a share alone, so that what has grown is weighed again.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue]

from ..scene.splats import Array, Splats
from .moments import Clusters, merged

NEIGHBOURS = 8
SHARE = 0.3  # of the clusters that a round takes away
COLOR_DEVIATION = 0.1  # σ
ROWS = 32_768  # clusters whose pairs are weighed at a time, which bounds the memory


def merge(splats: Splats, target: int, resolution: float, weights: Array | None = None) -> Splats:
    """``target`` Gaussians of the moments of what was near each other.

    Args:
        splats: finite parameters; DoG, slopes, curvatures, cuts and shifts are left out of account.
        target: number of primitives, at least 1; a smaller model stays as it is.
        resolution: world units, below which shapes are alike.
        weights: [N] > 0, how much of each primitive is seen; None: its opacity over its area.

    Raises ``ValueError`` for a target below 1.
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
    chosen = cheapest_disjoint(first, second, costs, most)
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


def cheapest_disjoint(first: Array, second: Array, costs: Array, most: int) -> Array:
    """[Q] indices of at most ``most`` pairs, from the cheapest on; each end is taken once, of equals the pair listed
    first.

    Args:
        first, second: [P] the clusters of each pair.
        costs: [P] of the pairs.
        most: at least 0.

    A loop in Python: it ends long before the list does, and takes a hundredth of the time of the costs.
    """
    taken, chosen = set(), []
    for pair in np.argsort(costs, kind="stable"):
        ends = first[pair], second[pair]
        if len(chosen) == most:
            break
        if taken.isdisjoint(ends):
            taken.update(ends)
            chosen.append(pair)
    return np.array(chosen, int)


def _log_determinants(covariances: Array, resolution: float) -> Array:
    (a, d, e), (_, b, f), (_, _, c) = np.moveaxis(covariances + resolution**2 * np.eye(3), 0, 2)
    determinant = a * (b * c - f * f) - d * (d * c - e * f) + e * (d * f - b * e)
    return np.log(np.maximum(determinant, resolution**6))
