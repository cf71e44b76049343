"""A parametrisation of the pseudo-Gaussian's scale factors that guarantees a ring: F = 1 + softplus(θ) > 1.

A pseudo-Gaussian wider than its primary leaves a negative ring around a positive peak. With log F free (the
released code) a primitive may turn narrow and lose the ring; with θ free it cannot. Models, files and the
rasterizer know log F only.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from .project import softplus

RING = "dog_ring_scales"  # name of θ among the parameters of the optimizer


def log_scales_on_device(theta: mi.Float) -> mi.Float:
    """log F. Differentiable."""
    return dr.log(1 + softplus(theta))


def log_scales_from_ring(theta: np.ndarray) -> np.ndarray:
    """log F in float64."""
    return np.log1p(np.logaddexp(0, theta, dtype=np.float64))


def ring_from_log_scales(log_scales: np.ndarray) -> np.ndarray:
    """θ in float64, the inverse. Raises ``ValueError`` unless F > 1 everywhere."""
    excess = np.expm1(np.asarray(log_scales, np.float64))  # F - 1
    if not np.all(excess > 0):
        raise ValueError("a ring needs F > 1 for every axis of every primitive")
    return excess + np.log(-np.expm1(-excess))
