"""Relocation (3DGS-MCMC, Kheradmand et al. 2024, Sec. 4.3, Eq. 9): more copies of a primitive, and the same picture.

A primitive of opacity o becomes n in the same place, each of opacity o' and scales s' = f s:

    o' = 1 - (1 - o)^(1/n)                        so that they cover as much at the centre, 1 - (1 - o')^n = o
    f  = o / Σ_{k=1..n} C(n, k) (-1)^(k+1) o'^k / √k

With this f what they cover together along a line through the centre adds up to what the one covered:
∫ 1 - (1 - o' G(x/f))^n dx = ∫ o G(x) dx, for ∫ G^k = ∫ G / √k. (The double sum of the paper is this one, as
Σ_{i=k..n} C(i - 1, k - 1) = C(n, k).)
"""

from __future__ import annotations

import math

import numpy as np

from ...scene.opacity import sigmoid
from ...training.optimizer.splat_optimizer import SplatOptimizer

MAX_COPIES = 50  # of one primitive; more are treated as so many, as in the authors' code
MAX_OPACITY = 1 - float(np.finfo(np.float32).eps)
ORDERS = np.arange(1, MAX_COPIES + 1)  # k
BINOMIALS = np.array([[math.comb(n, int(k)) for k in ORDERS] for n in range(MAX_COPIES + 1)], np.float64)


def shared(opacity: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[N] each: opacity of every one of ``count`` copies of a primitive, and the factor on its scales.

    Args:
        opacity: [N] of the primitive, 0 to 1.
        count: [N] at least 1.
    """
    n = np.clip(count, 1, MAX_COPIES)
    o = np.clip(np.asarray(opacity, np.float64), 1e-12, MAX_OPACITY)
    each = -np.expm1(np.log1p(-o) / n)  # 1 - (1 - o)^(1/n)
    terms = BINOMIALS[n] * each[:, None] ** ORDERS / np.sqrt(ORDERS)  # [N, MAX_COPIES], 0 for k > n
    return each, o / (terms @ (-1.0) ** (ORDERS + 1))


def draw(weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """[count] indices, drawn with replacement in proportion to ``weights`` [N], of which one is above 0 at least."""
    weights = np.asarray(weights, np.float64)
    return rng.choice(len(weights), count, p=weights / weights.sum())


def relocate(optimizer: SplatOptimizer, dead: np.ndarray, sources: np.ndarray, min_opacity: float) -> None:
    """Replace the rows ``dead`` by copies of the rows ``sources``, and share what those cover among their copies.

    Rows that have changed begin with moments of zero and as plain Gaussians. The number of primitives stays.

    Args:
        dead: [D] rows that are given up, none of them a source.
        sources: [D] the row that each of them becomes a copy of; a row may be named several times.
        min_opacity: of a copy.
    """
    index = np.arange(optimizer.n)
    index[dead] = sources
    _copy(optimizer, index, np.concatenate([dead, sources]), min_opacity)


def duplicate(optimizer: SplatOptimizer, sources: np.ndarray, min_opacity: float) -> None:
    """Append copies of the rows ``sources`` [D], as ``relocate`` makes them; a row may be named several times."""
    n = optimizer.n
    added = np.arange(n, n + len(sources))
    _copy(optimizer, np.concatenate([np.arange(n), sources]), np.concatenate([added, sources]), min_opacity)


def _copy(optimizer: SplatOptimizer, index: np.ndarray, changed: np.ndarray, min_opacity: float) -> None:
    """Row r becomes a copy of ``index[r]``; ``changed`` are the rows of all that have copies, and of these."""
    if not len(changed):
        return
    changed = np.unique(changed)
    fresh = np.zeros(len(index), bool)
    fresh[changed] = True
    copies = np.bincount(index)[index[changed]]
    optimizer.rearrange(index, fresh)
    logits = optimizer.numpy("logit_opacities")[changed].astype(np.float64)
    opacity, factor = shared(sigmoid(logits), copies)
    opacity = np.clip(opacity, min_opacity, MAX_OPACITY)
    optimizer.assign("logit_opacities", np.log(opacity) - np.log1p(-opacity), changed)
    log_scales = optimizer.numpy("log_scales")[changed]
    optimizer.assign("log_scales", log_scales + np.log(factor)[:, None], changed)
