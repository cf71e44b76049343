"""Colours that vary over their primitive: how they vary over the image, one lane per primitive (docs/slopes.md).

At w standard deviations along its axes a primitive has the colour c + Σ w_a s_a, with a slope s_a per axis and channel.
A pixel at the offset d from its centre sees c + gx dx + gy dy with (gx, gy) = Σ_a s_a ∂E[w_a | d]/∂d (``own_axes.py``).
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

CHANNELS = 3
COLUMNS = 2 * CHANNELS  # gx of the channels, then gy
ROW = 3 * CHANNELS  # of ``color_slopes``: by axis, then channel


def slopes_on_screen(slopes: list, per_pixel: list[tuple]) -> list:
    """gx of the three channels, then gy, per pixel; [N] each.

    Args:
        slopes: ``ROW`` arrays [N], zeros for a primitive without.
        per_pixel: ``own_axes_per_pixel``.
    """
    gx: list[Any] = [0] * CHANNELS
    gy: list[Any] = [0] * CHANNELS
    for a, (to_x, to_y) in enumerate(per_pixel):
        for k in range(CHANNELS):
            slope = slopes[CHANNELS * a + k]
            gx[k], gy[k] = dr.fma(slope, to_x, gx[k]), dr.fma(slope, to_y, gy[k])
    return [mi.Float(g) for g in (*gx, *gy)]
