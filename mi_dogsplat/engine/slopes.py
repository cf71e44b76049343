"""Colours that vary over their primitive: how they vary over the image, one lane per primitive (docs/slopes.md).

At w standard deviations along its axes a primitive has the colour c + Σ w_a s_a, with a slope s_a per axis and channel.
A pixel at the offset d from its centre sees all of a ray, on which w has the mean (the kernel is Gaussian in w, and so
are its sections)

    E[w | d] = Vᵀ Σ'⁻¹ d,   V = J W R S,   Σ' = V Vᵀ + 0.3 I,

which is linear in d: c + gx dx + gy dy with (gx, gy) = Σ_a s_a V_aᵀ Σ'⁻¹. In the kernel's own numbers (``project.py``)
Σ'⁻¹ = 2 ln 2 KᵀK with K = [[ux, uy], [0, vy]].
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

CHANNELS = 3
COLUMNS = 2 * CHANNELS  # gx of the channels, then gy
ROW = 3 * CHANNELS  # of ``color_slopes``: by axis, then channel
TWO_LN2 = 1.3862943611198906


def slopes_on_screen(slopes: list, axes: list, scales: list, kernel: tuple) -> list:
    """gx of the three channels, then gy, per pixel; [N] each.

    Args:
        slopes: ``ROW`` arrays [N], zeros for a primitive without.
        axes: J W R, 2 x 3 arrays [N]; with ``scales``, 3 arrays [N], the columns V_a.
        kernel: ux, uy, vy of the primaries.
    """
    ux, uy, kernel_vy = kernel
    gx: list[Any] = [0] * CHANNELS
    gy: list[Any] = [0] * CHANNELS
    for a, scale in enumerate(scales):
        vx, vy = axes[0][a] * scale, axes[1][a] * scale
        u, v = dr.fma(ux, vx, uy * vy), kernel_vy * vy  # K V_a, which is never above 1 / √(2 ln 2)
        to_x, to_y = TWO_LN2 * ux * u, TWO_LN2 * dr.fma(uy, u, kernel_vy * v)
        for c in range(CHANNELS):
            slope = slopes[CHANNELS * a + c]
            gx[c], gy[c] = dr.fma(slope, to_x, gx[c]), dr.fma(slope, to_y, gy[c])
    return [mi.Float(g) for g in (*gx, *gy)]
