"""Colours that vary over their primitive: how they vary over the image, one lane per primitive (docs/slopes.md).

At w standard deviations along its axes a primitive has the colour c + Σ w_a s_a, with a slope s_a per axis and channel.
A pixel at the offset d from its centre sees all of a ray, on which w has the mean (the kernel is Gaussian in w, and so
are its sections)

    E[w | d] = Vᵀ Σ'⁻¹ d,   V = J W R S,   Σ' = V Vᵀ + 0.3 I,

which is linear in d: c + gx dx + gy dy with (gx, gy) = Σ_a s_a V_aᵀ Σ'⁻¹. Of needles Σ'⁻¹ V_a would cancel to noise, as
would its derivative. So it is taken from the minors of V, as the determinant of Σ' is (``project.py``):

    Σ'⁻¹ V_a det Σ' = 0.3 V_a + Σ_b (V_a × V_b) V_b⊥,   (x, y)⊥ = (y, -x)
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

OTHERS = ((1, 2), (2, 0), (0, 1))
CHANNELS = 3
COLUMNS = 2 * CHANNELS  # gx of the channels, then gy
ROW = 3 * CHANNELS  # of ``color_slopes``: by axis, then channel


def slopes_on_screen(slopes: list, axes: list, scales: list, cut: list, low_pass: float) -> list:
    """gx of the three channels, then gy, per pixel; [N] each.

    Args:
        slopes: ``ROW`` arrays [N], zeros for a primitive without.
        axes: J W R, 2 x 3 arrays [N]; with ``scales``, 3 arrays [N], the columns V_a.
        cut: scales with which no axis is out of range; one that was longer shows nothing of its slope.
        low_pass: px², on the diagonal of Σ'.
    """
    gx: list[Any] = [0] * CHANNELS
    gy: list[Any] = [0] * CHANNELS
    V = [(axes[0][a] * scale, axes[1][a] * scale) for a, scale in enumerate(cut)]
    # P = Σ'⁻¹ V = r (r² Σ')⁻¹ (r V) for any r: with one that keeps r V below 1 no product of four is out of range
    longest = mi.Float(1)
    for vx, vy in V:
        longest = dr.maximum(longest, dr.detach(dr.maximum(abs(vx), abs(vy))))
    r = dr.rcp(longest)
    V, blur = [(vx * r, vy * r) for vx, vy in V], low_pass * r * r
    minors = [V[b][0] * V[c][1] - V[c][0] * V[b][1] for b, c in OTHERS]  # V_b x V_c
    raw_det = sum(dr.square(m) for m in minors)
    trace = sum(vx * vx + vy * vy for vx, vy in V)
    to_pixels = r / dr.fma(blur, trace + blur, raw_det)
    for a, (vx, vy) in enumerate(V):
        b, c = OTHERS[a]
        to_x = dr.fma(V[b][1], minors[c], dr.fma(-V[c][1], minors[b], blur * vx))
        to_y = dr.fma(V[c][0], minors[b], dr.fma(-V[b][0], minors[c], blur * vy))
        to_x, to_y = to_x * to_pixels, to_y * to_pixels
        for k in range(CHANNELS):
            slope = dr.select(cut[a] < scales[a], 0, slopes[CHANNELS * a + k])
            gx[k], gy[k] = dr.fma(slope, to_x, gx[k]), dr.fma(slope, to_y, gy[k])
    return [mi.Float(g) for g in (*gx, *gy)]
