"""What a camera does to the light of the scene: vignetting, exposure and white balance; and its gradient.

Notation, per pixel; c are the colours of the model, display-referred as a photograph

    L = D(c)                           linear light (the sRGB curve)
    Lᵢ' = 2^(gᵢ + a₁ r² + a₂ r⁴) Lᵢ    gains of the image, and vignetting, r = 0 at the centre and 1 at the corner
    y = D⁻¹(L')                        what the photograph shows

Sources: the chain of exposure, vignetting, colour correction and response of PPISP (NVIDIA 2026, arXiv:2601.18336). But
white balance is a factor for each channel (von Kries) and the response is that of sRGB, both fixed by measurement
(docs/experiments/photographs.md), and so is the light in which gains act. Goldman 2010 (vignetting, an even polynomial
of r).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..scene.appearance import GAINS, N_NUMBERS, VIGNETTING

Array = NDArray[np.float64]
LN2 = math.log(2)


def formed(image: ArrayLike, r_sq: ArrayLike, numbers: ArrayLike) -> Array:
    """The photograph [..., 3] that a camera takes of what the model shows, ``image`` [..., 3].

    ``r_sq`` [...]: squared distance of a pixel from the centre, 1 at the corner. ``numbers`` [5]: see
    ``scene/appearance.py``.
    """
    return encoded(_factors(r_sq, numbers) * decoded(np.asarray(image, np.float64)))


def formed_gradients(image: ArrayLike, r_sq: ArrayLike, numbers: ArrayLike, adjoint: ArrayLike) -> tuple[Array, Array]:
    """The gradients of Σ adjoint · formed by the image [..., 3] and by the numbers [5]."""
    c, factors = np.asarray(image, np.float64), _factors(r_sq, numbers)
    received = factors * decoded(c)
    q = np.asarray(adjoint, np.float64) * encoded_slope(received)  # adjoint of L'
    logs, r = q * received * LN2, np.asarray(r_sq, np.float64)[..., None]
    by_numbers = np.zeros(N_NUMBERS)
    by_numbers[GAINS] = logs.reshape(-1, 3).sum(0)
    by_numbers[VIGNETTING] = (logs * r).sum(), (logs * r**2).sum()
    return q * factors * decoded_slope(c), by_numbers


def _factors(r_sq: ArrayLike, numbers: ArrayLike) -> Array:
    """L' / L, [..., 3]."""
    p, r = np.asarray(numbers, np.float64), np.asarray(r_sq, np.float64)[..., None]
    a_1, a_2 = p[VIGNETTING]
    return np.exp2(p[GAINS] + a_1 * r + a_2 * r**2)


def decoded(c: Array) -> Array:
    """D, the sRGB curve (IEC 61966-2-1) to linear light; negative values stay linear."""
    return np.where(c <= 0.04045, c / 12.92, ((np.maximum(c, 0.04045) + 0.055) / 1.055) ** 2.4)


def decoded_slope(c: Array) -> Array:
    """dD/dc."""
    return np.where(c <= 0.04045, 1 / 12.92, 2.4 / 1.055 * ((np.maximum(c, 0.04045) + 0.055) / 1.055) ** 1.4)


def encoded(light: Array) -> Array:
    """D⁻¹."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055)


def encoded_slope(light: Array) -> Array:
    """dD⁻¹/dL."""
    return np.where(light <= 0.0031308, 12.92, 1.055 / 2.4 * np.maximum(light, 0.0031308) ** (1 / 2.4 - 1))
