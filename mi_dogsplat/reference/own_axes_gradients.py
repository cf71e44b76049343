"""The derivative of what changes per pixel: back to per standard deviation, and to the primitive's shape; in float64.

Notation of `forward.py` and `project_gradients.py`, and
    V = C S          [2, 3] the scaled axes on the screen, P = Sigma'^-1 V, so that w = P^T d
    g = P values     [2, K] for slopes of K = 3 channels, or the normal of a cut, K = 1
    A = P Q P^T      [2, 2] for the curvatures Q of a brightness

From dP = Sigma'^-1 dV - Sigma'^-1 (dV V^T + V dV^T) P, with δP = δg values^T, H = P^T V and G = P^T δP:
    δV = Sigma'^-1 δP (1 - H) - P G^T,   V^T δV = G (1 - H) - H G^T
1 - H is what the pixel does not tell of w. On large primitives it is next to nothing, but for the line of sight, which
is n = v_0 x v_1 from the rows of V. So it is taken from its own formula, the adjugate of V^T V + .3 over det Sigma':
    1 - H = (n n^T + .3 (tr(V^T V) - V^T V) + .09) / det Sigma'
"""

from __future__ import annotations

import math

import numpy as np

from ..scene.cuts import STEEPEST
from .own_axes import lengths, quadratic_forms
from .projection import LOW_PASS, conics_times_axes, determinants, symmetric


def own_axes_backward(C: np.ndarray, scales: np.ndarray, cov2d: np.ndarray, conics: np.ndarray, values: np.ndarray,
                      δg: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """δvalues as the values are, δlog_scales [n, 3], δω [n, 3] and δC [n, 2, 3].

    From δg [n, K, 2], the adjoint of P^T values, and the values per standard deviation, [n, 3, K], or [n, 3] for K = 1.
    """
    shape = values.shape
    values = values.reshape(*shape[:2], math.prod(shape[2:]))  # not -1, which nothing would not have
    S, δg = scales[:, None, :], δg.swapaxes(1, 2)  # [n, 1, 3], [n, 2, 3]
    V, B = C * S, conics_times_axes(C, scales**2, cov2d, conics)  # B = Sigma'^-1 C
    P, δP = B * S, δg @ values.swapaxes(1, 2)
    n, gram = np.cross(V[:, 0], V[:, 1]), V.swapaxes(1, 2) @ V
    trace = (V**2).sum((1, 2))[:, None, None]
    adjugate = n[:, :, None] * n[:, None, :] + LOW_PASS * (trace * np.eye(3) - gram) + LOW_PASS**2 * np.eye(3)
    unseen = adjugate / determinants(cov2d, conics)  # 1 - H
    G = P.swapaxes(1, 2) @ δP
    δV = symmetric(conics) @ δP @ unseen - P @ G.swapaxes(1, 2)
    along = (G * unseen.swapaxes(1, 2)).sum(2) - ((P.swapaxes(1, 2) @ V) * G).sum(2)  # diagonal of V^T δV
    turned = (B.swapaxes(1, 2) @ δP @ unseen - B.swapaxes(1, 2) @ V @ G.swapaxes(1, 2)) * S  # C^T δV S
    δω = turned[:, [2, 0, 1], [1, 2, 0]] - turned[:, [1, 2, 0], [2, 0, 1]]
    return (P.swapaxes(1, 2) @ δg).reshape(shape), along, δω, δV * S


def cuts_backward(C: np.ndarray, scales: np.ndarray, cov2d: np.ndarray, conics: np.ndarray, normals: np.ndarray,
                  δh: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The same from δh [n, 2], the adjoint of `Projection.cuts`, and the normals [n, 3]."""
    P = conics_times_axes(C, scales**2, cov2d, conics) * scales[:, None, :]
    δg = no_steeper_backward(np.einsum("nij,nj->ni", P, normals), δh)
    return own_axes_backward(C, scales, cov2d, conics, normals, δg[:, None])


def no_steeper_backward(h: np.ndarray, δ: np.ndarray) -> np.ndarray:
    """δ of changes per pixel [n, 2], from that of what `no_steeper` makes of them.

    Where they are shortened their direction matters, and their length does not.
    """
    length = lengths(h)[:, None]
    at_least = np.maximum(length, STEEPEST)
    direction = h / at_least  # of length 1, where it is shortened
    turned = δ - (δ * direction).sum(1, keepdims=True) * direction
    return np.where(length > STEEPEST, turned * (STEEPEST / at_least), δ)


def curvatures_backward(C: np.ndarray, scales: np.ndarray, cov2d: np.ndarray, conics: np.ndarray, values: np.ndarray,
                        δA: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The same of A = P Q P^T, from δA [n, 2, 2] and the rows [n, 6] of Q.

    With symmetric δA and Q that is δP = 2 δA P Q, as of slopes Q with δg = 2 δA P, and δQ = P^T δA P is half of theirs.
    """
    P = conics_times_axes(C, scales**2, cov2d, conics) * scales[:, None, :]
    δg = (2 * δA @ P).swapaxes(1, 2)
    twice, δlog_scales, δω, δC = own_axes_backward(C, scales, cov2d, conics, quadratic_forms(values), δg)
    xx, yy, zz = np.einsum("naa->an", twice) / 2
    # an entry beside the diagonal is there twice
    return np.stack([xx, yy, zz, twice[:, 0, 1], twice[:, 0, 2], twice[:, 1, 2]], axis=1), δlog_scales, δω, δC
