"""How far linear radiance is from the truth where a screen shows nothing of it: above white, and deep in shadows.

Images are [H, W, 3], at least 0, of any unit: both measures are the same for images a thousand times brighter. Masks
are those of ``metrics.py``. Raises ``ValueError`` if shapes differ or a value is negative, NaN or infinite.
"""

from __future__ import annotations

import math

import flip_evaluator
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..support.srgb import luminance
from .metrics import PSNR_CAP, masked

SHOWN_AS_085 = 2.1189  # by ACES as FLIP has it: (0.9036 x² + 0.018 x) / (0.8748 x² + 0.354 x + 0.14)
MOST_STOPS = 30
MU = 5000.0  # of the curve, as HDR reconstruction has it since Kalantari and Ramamoorthi 2017


def evaluate_radiance(radiance: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> dict[str, float]:
    """``psnr_mu`` and ``hdr_flip`` of one view, as plain floats that JSON can hold."""
    return {"psnr_mu": psnr_mu(radiance, truth, mask), "hdr_flip": hdr_flip(radiance, truth, mask)}


def psnr_mu(radiance: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """PSNR in dB of log(1 + μ x) / log(1 + μ), where x is 1 at the brightest value of the truth, of pixels that count;
    ``PSNR_CAP`` at most.

    The curve is steep near black: an error of a tenth counts about alike in lamp and shadow.
    """
    a, b = _light(radiance, truth)
    if mask is not None:
        a, b = (x[np.asarray(mask) > 0] for x in (a, b))
    brightest = float(b.max()) or 1.0
    a, b = (np.log1p(MU * x / brightest) / math.log1p(MU) for x in (a, b))
    mse = float(np.mean((a - b) ** 2))
    return min(PSNR_CAP, -10 * math.log10(mse)) if mse > 0 else PSNR_CAP


def hdr_flip(radiance: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """HDR-FLIP (Andersson et al. 2021): of each pixel the largest FLIP error over all exposures that show something.

    67 pixels per degree, tone mapping by ACES. The exposures are those of the paper, of pixels that count and have any
    light; the library's own would be infinite, which ends the process, where half of the picture is black.
    """
    a, b = _light(radiance, truth)
    counts = np.ones(b.shape[:2], bool) if mask is None else np.asarray(mask) > 0
    b = np.where(counts[..., None], b, np.minimum(b, b[counts].max()))  # float32 may not hold more in this exposure
    a = masked(a, b, counts)
    low, high = _exposures(luminance(b[counts]))
    unit = 2.0**low  # so that float32 holds all
    test, reference = (np.ascontiguousarray(x * unit, np.float32) for x in (a, b))
    steps = {"startExposure": 0.0, "stopExposure": high - low, "numExposures": max(2, math.ceil(high - low))}
    error, _, _ = flip_evaluator.evaluate(reference, test, "HDR", True, False, False, steps)
    error = np.asarray(error)[..., 0]
    return float(np.mean(error[counts], dtype=np.float64))


def _exposures(luminances: NDArray[np.float64]) -> tuple[float, float]:
    """Stops at which the brightest pixel, and the median of those with light, are shown as 0.85; at most 30 apart."""
    lights = luminances[luminances > 0]
    if not len(lights):
        return 0.0, 1.0
    low, high = (math.log2(SHOWN_AS_085 / float(x)) for x in (lights.max(), np.median(lights)))
    return low, min(high, low + MOST_STOPS)


def _light(radiance: ArrayLike, truth: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    a, b = np.asarray(radiance, np.float64), np.asarray(truth, np.float64)
    if a.shape != b.shape or a.ndim != 3 or a.shape[2] != 3 or a.size == 0:
        raise ValueError(f"the picture is {list(a.shape)}, its truth {list(b.shape)}; both need the same [H, W, 3]")
    if not (np.isfinite(a).all() and np.isfinite(b).all() and min(a.min(), b.min()) >= 0):
        raise ValueError("a value of radiance is negative, NaN or infinite")
    return a, b
