"""Tangents of the planes of *composite*, given those of what it blends: the walk once more.

Notation as in ``composite.py``, and
    δx     tangent of x

From primitive to primitive, by the product rule: δC ← δC + δc α T + c δ(α T) and δT ← δT - δ(α T), which is the
derivative of T (1 - α). Offsets lead from the centre to the pixel, so that of a centre that moves is δdx = -δx.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr

from ..bands import PreparedView, WalkableView
from ..curvatures import curved_by, curved_slope
from ..cuts import by_plane
from ..geometry import MAX_ALPHA
from ..options import Settings
from ..screen_kernels import LN2
from ..slopes import CHANNELS
from ..tables import CentredKernel, KernelRow, parts_of
from .kept import Kept
from .pixels import Planes, planes_of
from .walk import Alphas, Meeting, Walk


def composite_forward(view: WalkableView, δsplats: list, δpseudo: list) -> Planes:
    """Tangents of the planes, given those that ``composite_backward`` returns."""
    planes = view.walked(lambda band, above: _composite_forward(band, δsplats, δpseudo, above), [])
    *δfeatures, δT = planes_of(planes, view.settings.n_features + 1)
    return Planes(δfeatures, δT)


def _composite_forward(view: PreparedView, δsplats: list, δpseudo: list, above: list) -> list:
    walk = Walk(view)

    def step(meeting: Meeting, T: list, δplanes: list) -> None:
        δT, *δC = δplanes
        alphas, features = walk.alphas(meeting), walk.features(meeting)
        δcolumns = [dr.gather(walk.types.Float, values, meeting.splat, meeting.active) for values in δsplats]
        δrow = RowTangents.of(δcolumns, view.settings)
        δfeatures = _of_features(walk, meeting, δrow)
        δα = _of_alphas(walk, meeting, alphas, δrow, δpseudo)
        for k, a in enumerate(alphas.values):
            weight, behind, goes_on = walk.advance(a, T[k], meeting, k)
            weight = dr.select(goes_on, weight, 0)
            δa = dr.select(goes_on & (a != 0), δα[k], 0)
            δweight = dr.select(goes_on, dr.fma(δa, T[k], a * δT[k]), 0)
            for δplane, feature, δfeature in zip(δC, features, δfeatures, strict=True):
                δplane[k] = dr.fma(δweight, feature[k], dr.fma(weight, δfeature[k], δplane[k]))
            passes = goes_on if walk.amplifies else goes_on & (a > 0)
            δT[k] = dr.select(passes, δT[k] - δweight, δT[k])
            T[k] = behind

    start = [walk.pixels.zeros() for _ in range(1 + view.settings.n_features)]
    _, (δT, *δC) = walk.run(step, start, "composite_forward", unroll=False)
    return walk.pixels.write([*δC, δT], above)


@dataclass
class RowTangents:
    """Of a primitive's row of the table."""

    kernel: CentredKernel
    features: list
    slopes: list
    curvatures: list
    cuts: list

    @staticmethod
    def of(columns: list, settings: Settings) -> RowTangents:
        n = len(CentredKernel._fields)
        return RowTangents(CentredKernel(*columns[:n]), *parts_of(columns[n:], settings))


def _of_features(walk: Walk, meeting: Meeting, δrow: RowTangents) -> list[list]:
    """δ of ``Walk.features``: [feature][pixel]."""
    offsets, slopes, centre = walk.offsets(meeting), meeting.row.slopes, δrow.kernel
    planes = [[δfeature] * len(offsets) for δfeature in δrow.features]
    for c in range(CHANNELS if slopes else 0):
        gx, gy, δgx, δgy = slopes[c], slopes[CHANNELS + c], δrow.slopes[c], δrow.slopes[CHANNELS + c]
        δcenter = δrow.features[c] - gx * centre.x - gy * centre.y
        planes[c] = [dr.fma(δgx, dx, dr.fma(δgy, dy, δcenter)) for dx, dy in offsets]
    for k, (dx, dy) in enumerate(offsets if δrow.curvatures else ()):
        by_x, by_y = curved_slope(meeting.row.curvatures, dx, dy)
        δbrightness = curved_by(δrow.curvatures, dx, dy) - by_x * centre.x - by_y * centre.y
        for c in range(CHANNELS):
            planes[c][k] = planes[c][k] + δbrightness
    return planes


def _of_alphas(walk: Walk, meeting: Meeting, alphas: Alphas, δrow: RowTangents, δpseudo: list) -> list:
    """δα at the pixels of the block, as if none were ignored."""
    offsets, centre = walk.offsets(meeting), δrow.kernel
    planes = zip(alphas.kept, by_plane(meeting.row.cuts), by_plane(δrow.cuts), strict=True)
    δlog_g = [_of_kept(kept, offsets, centre, h, δh) for kept, h, δh in planes]
    δα = _of_kernel(alphas.primary, offsets, meeting.row.kernel, δrow.kernel, δlog_g)
    if alphas.pseudo is None:
        return δα
    is_dog = alphas.is_dog
    own = [dr.gather(walk.types.Float, values, alphas.dog_row, is_dog) for values in δpseudo]
    row = walk.pseudo_row(dr.select(is_dog, alphas.dog_row, 0))
    row = row._replace(**{name: dr.select(is_dog, getattr(row, name), 0) for name in ("ux", "uy", "vy")})
    δα_pseudo = _of_kernel(alphas.pseudo, offsets, row, CentredKernel(centre.x, centre.y, *own), δlog_g)
    return [a - b for a, b in zip(δα, δα_pseudo, strict=True)]


def _of_kernel(values: list, offsets: list, kernel: KernelRow, δ: CentredKernel, δlog_g: list[list]) -> list:
    """δ of 2^p g = ``values`` at the pixels of the block, zero where it is limited to .99.

    δ(2^p g) = ln 2 2^p g (δp + δlog2 g), δp = δlo - 2 (u δu + v δv). ``δlog_g``: δlog2 g by plane.
    """
    ux, uy, vy = kernel.ux, kernel.uy, kernel.vy
    result = []
    for k, (value, (dx, dy)) in enumerate(zip(values, offsets, strict=True)):
        u, v = dr.fma(ux, dx, uy * dy), vy * dy
        δu = δ.ux * dx + δ.uy * dy - ux * δ.x - uy * δ.y
        δv = δ.vy * dy - vy * δ.y
        δp = δ.lo - 2 * (u * δu + v * δv)
        for of_plane in δlog_g:
            δp = δp + of_plane[k]
        result.append(dr.select(value < MAX_ALPHA, LN2 * value * δp, 0))
    return result


def _of_kept(kept: Kept, offsets: list, centre: CentredKernel, h: list, δh: list) -> list:
    """δ of log2 g of a plane at the pixels of the block: what ``kept.falls`` says, times δ of hx dx + hy dy."""
    (hx, hy), (δhx, δhy) = h, δh
    δcenter = -hx * centre.x - hy * centre.y
    δexponents = [dr.fma(δhx, dx, dr.fma(δhy, dy, δcenter)) for dx, dy in offsets]
    return [fall * δexponent for fall, δexponent in zip(kept.falls, δexponents, strict=True)]
