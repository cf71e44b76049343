"""How far along its own axes a primitive is seen: w, in standard deviations, over the image; one lane per primitive.

A pixel at the offset d from its centre sees all of a ray, on which w has the mean (the kernel is Gaussian in w, and so
are its sections)

    E[w | d] = Vᵀ Σ'⁻¹ d,   V = J W R S,   Σ' = V Vᵀ + 0.3 I,

which is linear in d. Of needles Σ'⁻¹ V_a would cancel to noise, as would its derivative. So it is taken from the minors
of V, as the determinant of Σ' is (``screen_kernels.py``):

    Σ'⁻¹ V_a det Σ' = 0.3 V_a + Σ_b (V_a × V_b) V_b⊥,   (x, y)⊥ = (y, -x)
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from .screen_kernels import LOW_PASS

OTHERS = ((1, 2), (2, 0), (0, 1))


def own_axes_per_pixel(axes: list, scales: list, in_range: list) -> list[tuple]:
    """(to x, to y): by how much E[w_a | d] changes per pixel, for each axis a; [N] each.

    Args:
        axes: J W R, 2 x 3 arrays [N]; with ``scales``, 3 arrays [N], the columns V_a.
        in_range: scales with which no axis is out of range; one that was longer changes nothing over the image.
    """
    V = [(axes[0][a] * scale, axes[1][a] * scale) for a, scale in enumerate(in_range)]
    # P = Σ'⁻¹ V = r (r² Σ')⁻¹ (r V) for any r: with one that keeps r V below 1 no product of four is out of range
    longest = mi.Float(1)
    for vx, vy in V:
        longest = dr.maximum(longest, dr.detach(dr.maximum(abs(vx), abs(vy))))
    r = dr.rcp(longest)
    V, blur = [(vx * r, vy * r) for vx, vy in V], LOW_PASS * r * r
    minors = [V[b][0] * V[c][1] - V[c][0] * V[b][1] for b, c in OTHERS]  # V_b x V_c
    raw_det = sum(dr.square(m) for m in minors)
    trace = sum(vx * vx + vy * vy for vx, vy in V)
    to_pixels = r / dr.fma(blur, trace + blur, raw_det)
    found = []
    for a, (vx, vy) in enumerate(V):
        b, c = OTHERS[a]
        to_x = dr.fma(V[b][1], minors[c], dr.fma(-V[c][1], minors[b], blur * vx))
        to_y = dr.fma(V[c][0], minors[b], dr.fma(-V[b][0], minors[c], blur * vy))
        as_it_is = in_range[a] >= scales[a]
        found.append(tuple(dr.select(as_it_is, to * to_pixels, 0) for to in (to_x, to_y)))
    return found
