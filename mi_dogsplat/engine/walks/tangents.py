"""Tangents of the planes of *composite*, given those of what it blends: the walk once more.

Notation as in ``composite.py``, and
    δx     tangent of x
"""

from __future__ import annotations

import drjit as dr

from ..bands import PreparedView, WalkableView
from ..curvatures import curved_by, curved_slope
from ..cuts import by_plane
from ..geometry import MAX_ALPHA
from ..project import LN2
from ..slopes import CHANNELS
from ..tables import CentredKernel, parts_of
from .kept import Kept
from .pixels import Planes, planes_of
from .walk import Meeting, Walk


def composite_forward(view: WalkableView, δsplats: list, δpseudo: list) -> Planes:
    """Tangents of the planes, given those that ``composite_backward`` returns."""
    planes = view.walked(lambda band, above: _composite_forward(band, δsplats, δpseudo, above), [])
    *δfeatures, δT = planes_of(planes, view.settings.n_features + 1)
    return Planes(δfeatures, δT)


def _composite_forward(view: PreparedView, δsplats: list, δpseudo: list, above: list) -> list:
    walk, features, n = Walk(view), range(view.settings.n_features), len(CentredKernel._fields)

    def tangents(values: list, meeting: Meeting, ux, uy, vy, δ: CentredKernel, δkept: list[list]) -> list:
        """δ of 2^p g at the pixels of the block, zero where it is limited to .99; ``δkept``: δ of log2 g by plane."""
        result = []
        for k, (value, (x, y)) in enumerate(zip(values, walk.offsets(meeting), strict=True)):
            u, v = dr.fma(ux, x, uy * y), vy * y
            δu = δ.ux * x + δ.uy * y - ux * δ.x - uy * δ.y
            δv = δ.vy * y - vy * δ.y
            δp = δ.lo - 2 * (u * δu + v * δv)
            for δlog_g in δkept:
                δp = δp + δlog_g[k]
            result.append(dr.select(value < MAX_ALPHA, LN2 * value * δp, 0))
        return result

    def tangents_of_kept(kept: Kept, meeting: Meeting, δ: CentredKernel, hx, hy, δhx, δhy) -> list:
        """δ of log2 g of a plane at the pixels of the block."""
        δcenter = -hx * δ.x - hy * δ.y
        δexponents = [dr.fma(δhx, x, dr.fma(δhy, y, δcenter)) for x, y in walk.offsets(meeting)]
        return [fall * δexponent for fall, δexponent in zip(kept.falls, δexponents, strict=True)]

    def tangents_of_features(meeting: Meeting, δ: CentredKernel, δf: list, δslopes: list, δq: list) -> list[list]:
        """δ of ``Walk.features``: [feature][pixel]."""
        offsets, slopes = walk.offsets(meeting), meeting.row.slopes
        planes = [[δfeature] * len(offsets) for δfeature in δf]
        for f in range(len(slopes) // 2):
            gx, gy, δgx, δgy = slopes[f], slopes[CHANNELS + f], δslopes[f], δslopes[CHANNELS + f]
            δcenter = δf[f] - gx * δ.x - gy * δ.y
            planes[f] = [dr.fma(δgx, x, dr.fma(δgy, y, δcenter)) for x, y in offsets]
        for k, (x, y) in enumerate(offsets if δq else ()):
            by_x, by_y = curved_slope(meeting.row.curvatures, x, y)
            δbrightness = curved_by(δq, x, y) - by_x * δ.x - by_y * δ.y
            for f in range(CHANNELS):
                planes[f][k] = planes[f][k] + δbrightness
        return planes

    def step(meeting: Meeting, T: list, δplanes: list) -> None:
        δT, *δC = δplanes
        alphas = walk.alphas(meeting)
        δrow = [dr.gather(walk.types.Float, values, meeting.splat, meeting.active) for values in δsplats]
        δ, kernel, values = CentredKernel(*δrow[:n]), meeting.row.kernel, walk.features(meeting)
        *δcolors, δcuts = parts_of(δrow[n:], view.settings)
        δvalues = tangents_of_features(meeting, δ, *δcolors)
        planes = zip(alphas.kept, by_plane(meeting.row.cuts), by_plane(δcuts), strict=True)
        δkept = [tangents_of_kept(kept, meeting, δ, *h, *δh) for kept, h, δh in planes]
        δα = tangents(alphas.primary, meeting, kernel.ux, kernel.uy, kernel.vy, δ, δkept)
        if alphas.pseudo is not None:
            is_dog = alphas.is_dog
            own = [dr.gather(walk.types.Float, values, alphas.dog_row, is_dog) for values in δpseudo]
            row = walk.pseudo_row(dr.select(is_dog, alphas.dog_row, 0))
            ux, uy, vy = (dr.select(is_dog, value, 0) for value in (row.ux, row.uy, row.vy))
            δα_pseudo = tangents(alphas.pseudo, meeting, ux, uy, vy, CentredKernel(δ.x, δ.y, *own), δkept)
            δα = [a - b for a, b in zip(δα, δα_pseudo, strict=True)]
        for k, a in enumerate(alphas.values):
            weight, behind, goes_on = walk.advance(a, T[k], meeting, k)
            weight = dr.select(goes_on, weight, 0)
            δa = dr.select(goes_on & (a != 0), δα[k], 0)
            δweight = dr.select(goes_on, dr.fma(δa, T[k], a * δT[k]), 0)
            for f in features:
                δC[f][k] = dr.fma(δweight, values[f][k], dr.fma(weight, δvalues[f][k], δC[f][k]))
            passes = goes_on if walk.amplifies else goes_on & (a > 0)
            δT[k] = dr.select(passes, δT[k] - δweight, δT[k])
            T[k] = behind

    start = [walk.pixels.zeros() for _ in range(1 + len(features))]
    _, (δT, *δC) = walk.run(step, start, "composite_forward", unroll=False)
    return walk.pixels.write([*δC, δT], above)
