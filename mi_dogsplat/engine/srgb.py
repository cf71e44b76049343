"""The sRGB curve and its slope in kernels, of values of any size; on the host: ``support/srgb.py``.

With p = 2.4 and the encoded value D of light L at hand, slopes need no second power: dL/dD = p L / (D + 0.055), and
dD/dL is (D + 0.055) / (p L). The plugins have a curve of their own, Mitsuba's (``plugin/transfer.py``).
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..support.srgb import KNEE, LINEAR_KNEE, OFFSET, POWER, SLOPE, WHITE_SLOPE


def decoded(value: Any) -> Any:
    """The light that an encoded value stands for; negative values stay on the line."""
    power = dr.power(dr.fma(dr.maximum(value, KNEE), 1 / (1 + OFFSET), OFFSET / (1 + OFFSET)), POWER)
    return dr.select(value <= KNEE, value * (1 / SLOPE), power)


def decoded_slope(value: Any, light: Any) -> Any:
    """d ``decoded`` / d value; ``light`` is ``decoded(value)``."""
    return dr.select(value <= KNEE, 1 / SLOPE, POWER * light / (value + OFFSET))


def encoded(light: Any) -> Any:
    """The inverse of ``decoded``; NaN stays NaN."""
    power = dr.fma(1 + OFFSET, dr.power(dr.maximum(light, LINEAR_KNEE), 1 / POWER), -OFFSET)
    return dr.select(light > LINEAR_KNEE, power, SLOPE * light)


def encoded_slope(value: Any, light: Any) -> Any:
    """d ``encoded`` / d light; ``value`` is ``encoded(light)``."""
    return dr.select(light <= LINEAR_KNEE, SLOPE, (value + OFFSET) / (POWER * light))


def encoded_slope_of(light: Any) -> Any:
    """The same where ``encoded(light)`` is not at hand."""
    power: Any = dr.power(dr.maximum(light, LINEAR_KNEE), 1 / POWER - 1)
    return dr.select(light > LINEAR_KNEE, WHITE_SLOPE * power, SLOPE)
