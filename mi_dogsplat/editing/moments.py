"""Primitives as clusters of what they have become one of, and back: the arithmetic of merging.

Notation: a cluster has a weight w (how much of it is seen), an absorbance τA, a mean μ, a covariance Σ and
SH coefficients c. Of two,

    w = w₁ + w₂,   μ = (w₁ μ₁ + w₂ μ₂) / w,   c = (w₁ c₁ + w₂ c₂) / w,
    Σ = (w₁ (Σ₁ + d₁ d₁ᵀ) + w₂ (Σ₂ + d₂ d₂ᵀ)) / w,   dᵢ = μᵢ - μ

so that a cluster has the moments of all that it was made of, in whatever order. τ = -log(1 - o) is the optical depth
of a primitive at its centre and A the area of its ellipsoid's mean shadow. Their product adds up: two primitives
behind each other block 1 - (1 - o₁)(1 - o₂), two beside each other what they did, spread over the larger shadow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ..scene.quaternions import rotation_from_quaternion
from ..scene.scales import finite_scales
from ..scene.splats import Array, Splats

MOST_OPACITY = 0.999  # of a primitive made from clusters; the engine blends no α above 0.99
LEAST_OPACITY = 1 / 255  # nothing is made invisible
SHADOW_POWER = 1.6075  # Thomsen's formula for the surface of an ellipsoid, right to 1.1 %
LEAST_VARIANCE = 1e-36  # scale², so that its log is a float32


@dataclass(frozen=True)
class Clusters:
    """N of them, float64."""

    weights: Array
    """[N] > 0"""
    absorbances: Array
    """[N] τA"""
    means: Array
    """[N, 3]"""
    covariances: Array
    """[N, 3, 3]"""
    sh_coeffs: Array
    """[N, K, 3]"""

    def __len__(self) -> int:
        return len(self.weights)

    @staticmethod
    def of(splats: Splats, weights: Array | None = None) -> Clusters:
        """Each primitive by itself, without what is DoG about it, whole, in its mean colour.

        Args:
            splats: finite parameters.
            weights: [N] > 0; None: the absorbances.
        """
        scales = finite_scales(splats.log_scales)  # [N, 3]
        logits = splats.logit_opacities.astype(np.float64)
        depths = np.minimum(np.logaddexp(0, logits), -np.log1p(-MOST_OPACITY))  # [N] -log(1 - sigmoid)
        absorbances = depths * shadows(scales)
        axes = rotation_from_quaternion(splats.quats.astype(np.float64)) * scales[:, None]  # [N, 3, 3]
        given = absorbances if weights is None else np.asarray(weights, np.float64)
        coefficients = splats.sh_coeffs.astype(np.float64)
        return Clusters(given, absorbances, splats.means.astype(np.float64), axes @ axes.swapaxes(1, 2), coefficients)

    def select(self, rows: Array) -> Clusters:
        """Those at an index or mask."""
        return Clusters(*(values[rows] for values in vars(self).values()))

    def joined(self, other: Clusters) -> Clusters:
        """Both lists, one behind the other."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Clusters(*(np.concatenate(pair) for pair in pairs))

    def splats(self) -> Splats:
        """A Gaussian for each: its moments, and the opacity that its absorbance has in its shadow."""
        variances, axes = np.linalg.eigh(self.covariances)  # ascending
        axes = axes * np.sign(np.linalg.det(axes))[:, None, None]  # rotations, no reflections
        scales = np.sqrt(np.maximum(variances, LEAST_VARIANCE))
        opacities = np.clip(-np.expm1(-self.absorbances / shadows(scales)), LEAST_OPACITY, MOST_OPACITY)
        return Splats(
            means=self.means,
            log_scales=np.log(scales),
            quats=Rotation.from_matrix(axes).as_quat() if len(self) else np.zeros((0, 4)),
            logit_opacities=np.log(opacities) - np.log1p(-opacities),
            sh_coeffs=self.sh_coeffs,
        )


def shadows(scales: Array) -> Array:
    """[N] mean area of the shadows of ellipsoids over all directions, over π: a quarter of their surface (Cauchy).

    Args:
        scales: half axes [N, 3].
    """
    a, b, c = scales.T**SHADOW_POWER
    return ((a * b + b * c + c * a) / 3) ** (1 / SHADOW_POWER)


def merged(first: Clusters, second: Clusters) -> Clusters:
    """Cluster i of both as one; as many of each."""
    weights = first.weights + second.weights
    share = (first.weights / weights)[:, None]  # [N, 1]
    difference = first.means - second.means  # [N, 3]
    spread = (share * (1 - share) * difference)[:, :, None] * difference[:, None]  # Σ wᵢ dᵢ dᵢᵀ / w
    share3 = share[:, :, None]
    return Clusters(
        weights,
        first.absorbances + second.absorbances,
        share * first.means + (1 - share) * second.means,
        share3 * first.covariances + (1 - share3) * second.covariances + spread,
        share3 * first.sh_coeffs + (1 - share3) * second.sh_coeffs,
    )
