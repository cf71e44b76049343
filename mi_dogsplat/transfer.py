"""The sRGB curve on the device, in both directions and differentiable; ``srgb.py`` is its twin.

Mitsuba's own (``mi.math``) is an approximation made for 0..1: a radiance of 100 loses 6 % on its way there and back.
"""

# Dr.Jit's stubs give the type of an expression as "object".
# pyright: reportReturnType=false
from __future__ import annotations

import drjit as dr
import mitsuba as mi


def srgb_to_linear(value: mi.Float) -> mi.Float:
    """sRGB encoded values to linear ones (IEC 61966-2-1), not clamped; negative ones stay linear."""
    curve = dr.power((dr.maximum(value, 0.04045) + 0.055) * (1 / 1.055), 2.4)
    return dr.select(value <= 0.04045, value * (1 / 12.92), curve)


def linear_to_srgb(value: mi.Float) -> mi.Float:
    """The inverse of ``srgb_to_linear``."""
    curve = dr.fma(1.055, dr.power(dr.maximum(value, 0.0031308), 1 / 2.4), -0.055)
    return dr.select(value <= 0.0031308, value * 12.92, curve)
