"""Lists of three arrays as vectors."""

from __future__ import annotations

from typing import Any

import drjit as dr


def dot(a: list, b: list) -> Any:
    """Of two lists of three."""
    return dr.fma(a[0], b[0], dr.fma(a[1], b[1], a[2] * b[2]))


def cross(a: list, b: list) -> list:
    """Of two lists of three."""
    x, y = dr.fma(a[1], b[2], -a[2] * b[1]), dr.fma(a[2], b[0], -a[0] * b[2])
    return [x, y, dr.fma(a[0], b[1], -a[1] * b[0])]
