"""From raw parameters, flat arrays of one lane per primitive, to what they mean; differentiable."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


def rotation_matrix(q: list[mi.Float]) -> list[list[mi.Float]]:
    """Rotation of a finite quaternion (x, y, z, w) of any length; the zero quaternion is the identity."""
    largest = dr.maximum(dr.maximum(abs(q[0]), abs(q[1])), dr.maximum(abs(q[2]), abs(q[3])))
    usable = largest > 0
    scale = dr.rcp(dr.select(usable, dr.detach(largest), 1))  # the square of a length need not be a float
    q = [dr.select(usable, k * scale, default) for k, default in zip(q, (0, 0, 0, 1), strict=True)]
    inv = dr.rsqrt(dr.fma(q[0], q[0], dr.fma(q[1], q[1], dr.fma(q[2], q[2], q[3] * q[3]))))
    x, y, z, w = (k * inv for k in q)
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def softplus(x: mi.Float) -> mi.Float:
    """log(1 + e^x) without overflow; -softplus(-x) is the log of the sigmoid, finite for every finite logit."""
    positive = x > 0  # not max(x, 0) and |x|: their derivatives would add up to 0 instead of 1/2 at x = 0
    return dr.select(positive, x, 0) + dr.log(1 + dr.exp(dr.select(positive, -x, x)))


def all_finite(values: list[mi.Float]) -> mi.Bool:
    """Lane by lane, whether each of the values is a finite number."""
    finite = dr.isfinite(values[0])
    for value in values[1:]:
        finite &= dr.isfinite(value)
    return finite
