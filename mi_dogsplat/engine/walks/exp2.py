"""2^x in half the instructions of ``dr.exp2`` on LLVM."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..arrays import array_types

POLYNOMIAL = (1.00000007, 0.693146967, 0.240221197, 0.0555071327, 0.00967554, 0.00132765)  # 2^x, |x| <= 1/2, to 8e-8


def exp2(x: Any) -> Any:
    """2^x to 2e-7 for -126 < x < 127; anything elsewhere, where ``dr.exp2`` also saturates.

    Adding 1.5 2^23 rounds x to an integer, whose low bits are then those of the sum: shifted, they are the exponent.
    """
    types = array_types()
    whole = x + 12582912.0
    rest = x - (whole - 12582912.0)
    value = types.Float(POLYNOMIAL[-1])
    for c in POLYNOMIAL[-2::-1]:
        value = dr.fma(value, rest, c)
    bits: Any = dr.reinterpret_array(types.Int, value)
    exponent: Any = dr.reinterpret_array(types.Int, whole)
    return dr.reinterpret_array(types.Float, bits + (exponent << 23))
