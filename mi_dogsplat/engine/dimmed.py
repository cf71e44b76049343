"""Primitives that are lit less: the colour that each has in every direction times a factor of light.

Of linear colours the factor k takes SH(direction) + 0.5 to k (SH(direction) + 0.5), which is a change of coefficients.
Of sRGB ones it is one too: above its linear foot the curve is 1.055 L^(1/2.4) - 0.055, so that light times k takes the
colour c to k' (c + 0.055) - 0.055 with k' = k^(1/2.4). Below c = 0.04 this is too dark, by .014 at most.
Slopes are differences of colours: they scale by k, or by k'; curvatures, of all channels, by the mean of theirs.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from ..scene.row_groups import CURVATURES, SH, SLOPES
from ..scene.sh_basis import C0
from ..support.srgb import OFFSET, POWER
from .curvatures import ROW as CURVATURE_ROW
from .sh_groups import ROW_COEFFICIENTS
from .slopes import ROW as SLOPE_ROW


def dimmed(params: dict, factor: list, linear: bool) -> dict:
    """``params`` with other colours, attached to the AD graph where the colours are.

    Args:
        params: raw parameters as flat arrays, of N primitives.
        factor: of linear radiance, not negative, three channels of [N]. A constant: it has no derivative.
        linear: colours are linear, not sRGB.
    """
    n = dr.width(params["logit_opacities"])
    gain: list[Any] = [dr.detach(k) + dr.zeros(mi.Float, n) for k in factor]
    if not linear:
        gain = [dr.power(k, 1 / POWER) for k in gain]
    black = 0 if linear else -OFFSET  # the colour that no factor changes
    of_rows: Any = dr.ravel(mi.Vector3f(*gain))  # [N, 3]
    sh, stored = params["sh_coeffs"], dr.width(params["sh_coeffs"]) // n
    dc = dr.arange(mi.UInt32, dr.width(sh)) % stored < 3
    k = _of_coefficients(of_rows, dr.arange(mi.UInt32, n), stored)
    changed = {"sh_coeffs": dr.fma(sh, k, dr.select(dc, (k - 1) * ((0.5 - black) / C0), 0))}
    if SLOPES.index in params:
        (name,) = SLOPES.names
        changed[name] = params[name] * _of_coefficients(of_rows, params[SLOPES.index], SLOPE_ROW)
    if CURVATURES.index in params:
        (name,) = CURVATURES.names
        red, green, blue = gain
        mean = (red + green + blue) / 3
        row = dr.arange(mi.UInt32, dr.width(params[name])) // CURVATURE_ROW
        changed[name] = params[name] * dr.gather(mi.Float, mean, dr.gather(mi.UInt32, params[CURVATURES.index], row))
    for degree, group in SH.items():
        if group.index in params:
            (name,) = group.names
            wide = 3 * ROW_COEFFICIENTS[degree]
            changed[name] = params[name] * _of_coefficients(of_rows, params[group.index], wide)
    return params | changed


def _of_coefficients(of_rows: mi.Float, index: mi.UInt32, stored: int) -> mi.Float:
    """[M, stored / 3, 3], flat: what [N, 3] has for the primitives ``index``."""
    i = dr.arange(mi.UInt32, dr.width(index) * stored)
    row = dr.gather(mi.UInt32, index, i // stored)
    return dr.gather(mi.Float, of_rows, dr.fma(row, 3, i % 3))
