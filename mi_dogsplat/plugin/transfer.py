"""Colours of primitives as light, and light as Mitsuba's variant has it; the sRGB curve in both directions.

The curve is differentiable; ``support/srgb.py`` is its twin. ``emitted``: what blended primitives add to light that
passes them.

Mitsuba's own (``mi.math``) is a fast approximation made for 0..1: a radiance of 100 loses 6 % on its way there and
back, one of 1000 three quarters. Brighter pixels take the formula: on the CPU in a branch, which packets without one
jump over; on CUDA every pixel computes both, as tracing the branch and its derivative takes Python .3 ms.
The curve of ``engine/srgb.py`` takes three times as long within 0..1, and nine values in ten get other bits there.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.arrays import array_types, if_stmt
from ..support.srgb import OFFSET, POWER


def srgb_to_linear(colors: list[mi.Float]) -> list[mi.Float]:
    """sRGB encoded channels to linear ones (IEC 61966-2-1), not clamped; negative ones stay linear."""
    return _by_brightness(colors, mi.math.srgb_to_linear, lambda v: dr.power((v + OFFSET) * (1 / (1 + OFFSET)), POWER))


def linear_to_srgb(colors: list[mi.Float]) -> list[mi.Float]:
    """The inverse of ``srgb_to_linear``."""
    return _by_brightness(colors, mi.math.linear_to_srgb, lambda v: dr.fma(1 + OFFSET, dr.power(v, 1 / POWER), -OFFSET))


def three_channels(spectrum: Any) -> list[mi.Float]:
    """Channels of a spectrum, in variants with one channel three times the same."""
    channels = list(spectrum)
    return channels * 3 if len(channels) == 1 else channels


def spectrum_of(colors: list[mi.Float]) -> Any:
    """The other way: ``mi.Spectrum`` of three channels, in variants with one channel their luminance."""
    return mi.luminance(mi.Color3f(colors)) if mi.is_monochromatic else mi.Spectrum(colors)


def mean_of(spectrum: Any) -> mi.Float:
    """Of the channels. ``dr.mean`` makes the width a literal, and a kernel of its own for each."""
    return dr.sum(spectrum) * (1 / len(spectrum))


def emitted(colors: list[mi.Float], T: mi.Float, linear: bool) -> list[mi.Float]:
    """Radiance of blended primitives where light that comes from behind is weakened by T. Differentiable.

    Primitives of linear colours send what was blended. Of sRGB ones the blended colour C is that of a coverage
    a = 1 - T by the mean colour C / a, which is converted: a linear(C / a). So it is the light of an opaque model where
    T is 0, and of a model of one colour everywhere; and no sum of it and T times what is behind is brighter than the
    brighter of both. Where DoG primitives subtract, C / a may be of any size or sign, and where colours vary over
    their primitives of either sign: what is beyond 0 and the larger of 1 and C counts as light over black, linear(C).
    """
    if linear:
        return colors
    coverage = 1 - T
    some = abs(coverage) > 1e-6
    inverse = dr.rcp(dr.select(some, coverage, 1))
    means = [dr.select(some, dr.clip(c * inverse, 0, dr.maximum(1, c)), 0) for c in colors]
    rests = [dr.fma(-coverage, mean, c) for c, mean in zip(colors, means, strict=True)]
    of_means, of_rests = srgb_to_linear(means), srgb_to_linear(rests)
    return [dr.fma(coverage, mean, rest) for mean, rest in zip(of_means, of_rests, strict=True)]


def _by_brightness(colors: list[mi.Float], within_one, above_one) -> list[mi.Float]:
    """Each channel by the one function up to 1, by the other above."""

    def bright(*colors):
        return [dr.select(c > 1, above_one(dr.maximum(c, 1)), within_one(dr.minimum(c, 1))) for c in colors]

    if not array_types().is_llvm:
        return bright(*colors)

    def usual(*colors):
        return [within_one(c) for c in colors]

    some = colors[0] > 1
    for c in colors[1:]:
        some |= c > 1
    # variables of its own: what they already have of a gradient a branch would add once more (Dr.Jit 1.5)
    return list(if_stmt(tuple(c * 1 for c in colors), some, bright, usual))
