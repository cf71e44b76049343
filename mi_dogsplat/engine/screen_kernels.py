"""The 2D kernel that a 3D Gaussian becomes on the image plane: of Σ' = V Vᵀ + 0.3 I, V = J W R S (``project.py``).

Its exponent dᵀ Σ'⁻¹ d / 2 is completed to squares,

    dᵀ Σ'⁻¹ d = Σ'_yy / det Σ' (dx - Σ'_xy / Σ'_yy dy)² + dy² / Σ'_yy,

the first of which is divided by the variance of x given y. In units of log2, with the opacity o folded in, that is

    p(d) = lo - u² - v²,   u = ux dx + uy dy,   v = vy dy,   lo = log2 o.

So the compositor needs neither a multiplication by the opacity nor a change of base, and logit opacities of any
magnitude stay finite. The expanded form A dx² + B dx dy + C dy² would cancel on needles: its rounding errors grow with
the square of their length in pixels, not with the length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

LOW_PASS = 0.3  # px², added to the diagonal of Σ' so that no primitive falls between the pixels
LOG2_E = 1.4426950408889634
LN2 = math.log(2)
MIN_ANTIALIAS_RATIO = 2.5e-5  # of determinants without and with the low-pass filter, as in Mip-Splatting's code
MAX_AXIS = 1e8  # px; a longer axis of a kernel is cut to this, which changes no pixel and keeps squares in range
MAX_DET = 2.0**62  # px⁴; the inverse square of a larger determinant is no float, and derivatives need it


@dataclass
class Kernels:
    """2D kernels on the image plane, R rows: p(d) = lo - (ux dx + uy dy)² - (vy dy)² (log2 of the value)."""

    ux: mi.Float
    uy: mi.Float
    vy: mi.Float
    lo: mi.Float
    variance_x: mi.Float  # Σ'_xx
    variance_y: mi.Float  # Σ'_yy


def scales_in_range(axes, scales) -> list:
    """Scales with which no axis is longer than ``MAX_AXIS``."""
    lengths = [dr.maximum(abs(dr.detach(x)), abs(dr.detach(y))) for x, y in zip(*axes, strict=True)]
    longest = [MAX_AXIS / length for length in lengths]
    # not the minimum, whose derivative multiplies that of an infinite scale by 0
    return [dr.select(s <= limit, s, limit) for s, limit in zip(scales, longest, strict=True)]


def in_unit(det: mi.Float) -> tuple:
    """(``det`` in a unit in which derivatives can divide by its square, 1 over that unit: a power of two, by which no
    bit changes)."""
    if not dr.grad_enabled(det):
        return det, 1.0
    unit = dr.select(det < MAX_DET, 1, 1 / MAX_DET)
    return det * unit, unit


def screen_kernels(axes, scales, log2_opacity, antialiased: bool) -> Kernels:
    """2D kernel of the 3D Gaussian whose scaled axes project to the columns of ``axes`` x ``scales``.

    vy² is the inverse of the variance of y, ux² that of the variance of x given y, both times log2(e) / 2.
    """
    scales = scales_in_range(axes, scales)
    v0 = [a * s for a, s in zip(axes[0], scales, strict=True)]  # J W R S, first row
    v1 = [a * s for a, s in zip(axes[1], scales, strict=True)]
    raw_xx = v0[0] * v0[0] + v0[1] * v0[1] + v0[2] * v0[2]
    raw_yy = v1[0] * v1[0] + v1[1] * v1[1] + v1[2] * v1[2]
    xy = v0[0] * v1[0] + v0[1] * v1[1] + v0[2] * v1[2]
    # det(V Vᵀ) as a sum of squared minors (Cauchy-Binet): xx yy - xy² would cancel to noise on needles
    m0, m1, m2 = v0[1] * v1[2] - v0[2] * v1[1], v0[2] * v1[0] - v0[0] * v1[2], v0[0] * v1[1] - v0[1] * v1[0]
    raw_det = m0 * m0 + m1 * m1 + m2 * m2
    det = raw_det + LOW_PASS * (raw_xx + raw_yy) + LOW_PASS * LOW_PASS
    if antialiased:
        factor = 0.5 * dr.log2(dr.maximum(MIN_ANTIALIAS_RATIO, raw_det / det))
        # of larger ones the ratio is above .999, and has next to no derivative
        log2_opacity = log2_opacity + dr.select(det < MAX_DET, factor, dr.detach(factor))
    xx, yy = raw_xx + LOW_PASS, raw_yy + LOW_PASS
    det, unit = in_unit(det)
    ux = dr.sqrt(0.5 * LOG2_E * yy * unit / det)
    return Kernels(ux, -ux * xy / yy, dr.sqrt(0.5 * LOG2_E / yy), log2_opacity, xx, yy)
