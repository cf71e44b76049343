"""Derivatives of *composite*: both modes replay the walk; nothing is stored per primitive and pixel.

Notation as in ``composite.py``, and
    δx     adjoint of x in backward mode, tangent of x in forward mode

Backward mode replays the walk in the same order and needs two numbers per pixel, T and the part of δC·C that is
still to come.
"""

from __future__ import annotations

from collections import namedtuple

import drjit as dr
import mitsuba as mi

from ..arrays import if_stmt
from ..bands import PreparedView, WalkableView
from ..curvatures import curved_by, curved_slope
from ..cuts import by_plane
from ..frozen import frozen
from ..geometry import MAX_ALPHA
from ..slopes import CHANNELS
from ..tables import parts_of, varying_columns
from .block_sums import curvature_adjoints, kernel_adjoints, plane_adjoints
from .kept import Kept
from .pixels import Planes, planes_of
from .slot_rows import SlotRows, columns_of, lanes_add_in_turn
from .walk import Alphas, Meeting, Walk

LN2 = 0.6931471805599453


class Projected(namedtuple("Projected", "x y ux uy vy lo")):
    """What blending depends on of a primitive, or its derivatives, without features and what varies over it."""


N_PSEUDO = 4  # the last of these are the pseudo-Gaussian's own; its centre is that of the primary


def composite_backward(view: WalkableView, blended: Planes, δ: Planes) -> tuple[list, list]:
    """Adjoints of the projected quantities, given those of the planes.

    Args:
        blended: what ``composite`` returned.
        δ: adjoints of it.

    Returns (δ of what ``Projected`` names, of each feature, and of what varies over primitives, [N] each;
    δ of its last ``N_PSEUDO`` of the pseudo-Gaussians, [M] each, nothing without DoG).
    """
    columns, dog_index = _columns(view), view.tables.dog_index
    in_turn = lanes_add_in_turn(mi.variant())

    def walk(band: PreparedView, above: tuple[list, list]) -> tuple[list, list]:
        δsplats, δpseudo = _composite_backward(band, blended, δ, in_turn, *above)
        of_pseudo = [] if dog_index is None else columns_of(δpseudo, band.lists, N_PSEUDO, dog_index)
        return columns_of(δsplats, band.lists, columns), of_pseudo

    return view.walked(walk, ([], []))


def _columns(view: WalkableView) -> int:
    return len(Projected._fields) + view.settings.n_features + varying_columns(view.settings)


@frozen
def _composite_backward(
    view: PreparedView, blended: Planes, δplanes: Planes, in_turn: bool, above: list, pseudo_above: list
) -> tuple[list, list]:
    walk, features = Walk(view), range(view.settings.n_features)
    rows = SlotRows(view.lists, _columns(view), in_turn)
    pseudo_rows = SlotRows(view.lists, N_PSEUDO, in_turn) if walk.has_dog else None
    pixels, blocks, Float = walk.pixels, walk.blocks, walk.types.Float

    δC = [pixels.read(plane) for plane in δplanes.features]
    # what is still to come of δC·C + δT T: all of it at the start
    rest = [δ * t for δ, t in zip(pixels.read(δplanes.T), pixels.read(blended.T), strict=True)]
    for plane, δ in zip(blended.features, δC, strict=True):
        rest = [dr.fma(c, d, r) for c, d, r in zip(pixels.read(plane), δ, rest, strict=True)]

    def pseudo_part(rows: SlotRows, alphas: Alphas, slot, dx, dy, δp: list) -> tuple:
        """Add what is the pseudo-Gaussian's own to its row, in a branch as its kernel; returns δ of x, y."""

        def add(slot, dog_row, dx, dy, δp):
            kernel = walk.pseudo_row(dog_row)
            δ = Projected(*kernel_adjoints(δp, kernel.ux, kernel.uy, kernel.vy, dx, dy, blocks))
            rows.add(slot, [*δ[-N_PSEUDO:]], True)
            return δ.x, δ.y

        return if_stmt((slot, alphas.dog_row, dx, dy, δp), alphas.is_dog, add, lambda *_: (Float(0), Float(0)))

    def cut_part(meeting: Meeting, planes: list[Kept], δp: list, δp_pseudo: list, δrow: Projected) -> tuple:
        """(δ of the row with what the centre does by way of the cuts, δ of hx and hy of each plane)."""
        both = [a + b for a, b in zip(δp, δp_pseudo, strict=True)] if δp_pseudo else δp
        δcuts = []
        for kept, (hx, hy) in zip(planes, by_plane(meeting.row.cuts), strict=True):
            δexponents = [δ * fall for δ, fall in zip(both, kept.falls, strict=True)]
            δx, δy, *δh = plane_adjoints(δexponents, hx, hy, meeting.dx, meeting.dy, blocks)
            δrow, δcuts = δrow._replace(x=δrow.x + δx, y=δrow.y + δy), δcuts + δh
        return δrow, δcuts

    def step(meeting: Meeting, T: list, rest: list) -> None:
        slot, colors, dx, dy = walk.slot(meeting), walk.features(meeting), meeting.dx, meeting.dy
        alphas = walk.alphas(meeting)
        δp, δp_pseudo, δbrightness = [], [], []
        δf = [Float(0) for _ in features]
        δby_column, δby_row = ([Float(0) for _ in meeting.row.slopes[:CHANNELS]] for _ in range(2))
        for k, a in enumerate(alphas.values):
            weight, behind, goes_on = walk.advance(a, T[k], meeting, k)
            weight = dr.select(goes_on, weight, 0)
            c = colors[0][k] * δC[0][k]
            for f in features:
                δf[f] = dr.fma(weight, δC[f][k], δf[f])
                if f:
                    c = dr.fma(colors[f][k], δC[f][k], c)
            for f in range(len(δby_column)):
                δcolor = weight * δC[f][k]
                δby_column[f] = dr.fma(k % blocks.width, δcolor, δby_column[f])
                δby_row[f] = dr.fma(k // blocks.width, δcolor, δby_row[f])
            if meeting.row.curvatures:
                δbrightness.append(weight * (δC[0][k] + δC[1][k] + δC[2][k]))
            rest[k] = dr.fma(-weight, c, rest[k])
            δα = LN2 * dr.fma(T[k], c, -walk.hidden(rest[k], a, a))
            # zero where the primitive was ignored, or the walk had ended
            δα = dr.select(goes_on & (a != 0), δα, 0)
            δp.append(dr.select(alphas.primary[k] < MAX_ALPHA, δα * alphas.primary[k], 0))
            if alphas.pseudo is not None:
                δp_pseudo.append(dr.select(alphas.pseudo[k] < MAX_ALPHA, -δα * alphas.pseudo[k], 0))
            T[k] = behind
        kernel = meeting.row.kernel
        δrow = Projected(*kernel_adjoints(δp, kernel.ux, kernel.uy, kernel.vy, dx, dy, blocks))
        if pseudo_rows is not None:
            δx, δy = pseudo_part(pseudo_rows, alphas, slot, dx, dy, δp_pseudo)
            δrow = δrow._replace(x=δrow.x + δx, y=δrow.y + δy)
        δgx = [dr.fma(dx, δ, by) for δ, by in zip(δf, δby_column, strict=False)]
        δgy = [dr.fma(dy, δ, by) for δ, by in zip(δf, δby_row, strict=False)]
        for δ, gx, gy in zip(δf, meeting.row.slopes, meeting.row.slopes[CHANNELS:], strict=False):
            δrow = δrow._replace(x=dr.fma(-gx, δ, δrow.x), y=dr.fma(-gy, δ, δrow.y))  # dx, dy are from there
        δq = []
        if meeting.row.curvatures:
            δx, δy, *δq = curvature_adjoints(δbrightness, meeting.row.curvatures, dx, dy, blocks)
            δrow = δrow._replace(x=δrow.x + δx, y=δrow.y + δy)
        δrow, δcuts = cut_part(meeting, alphas.kept, δp, δp_pseudo, δrow)
        rows.add(slot, [*δrow, *δf, *δgx, *δgy, *δq, *δcuts], meeting.active)

    walk.run(step, rest, "composite_backward")
    return rows.sums(above=above), pseudo_rows.sums(view.tables.dog_index, pseudo_above) if pseudo_rows else []


def composite_forward(view: WalkableView, δsplats: list, δpseudo: list) -> Planes:
    """Tangents of the planes, given those that ``composite_backward`` returns."""
    planes = view.walked(lambda band, above: _composite_forward(band, δsplats, δpseudo, above), [])
    *δfeatures, δT = planes_of(planes, view.settings.n_features + 1)
    return Planes(δfeatures, δT)


def _composite_forward(view: PreparedView, δsplats: list, δpseudo: list, above: list) -> list:
    walk, features, n = Walk(view), range(view.settings.n_features), len(Projected._fields)

    def tangents(values: list, meeting: Meeting, ux, uy, vy, δ: Projected, δkept: list[list]) -> list:
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

    def tangents_of_kept(kept: Kept, meeting: Meeting, δ: Projected, hx, hy, δhx, δhy) -> list:
        """δ of log2 g of a plane at the pixels of the block."""
        δcenter = -hx * δ.x - hy * δ.y
        δexponents = [dr.fma(δhx, x, dr.fma(δhy, y, δcenter)) for x, y in walk.offsets(meeting)]
        return [fall * δexponent for fall, δexponent in zip(kept.falls, δexponents, strict=True)]

    def tangents_of_features(meeting: Meeting, δ: Projected, δf: list, δslopes: list, δq: list) -> list[list]:
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
        δ, kernel, values = Projected(*δrow[:n]), meeting.row.kernel, walk.features(meeting)
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
            δα_pseudo = tangents(alphas.pseudo, meeting, ux, uy, vy, Projected(δ.x, δ.y, *own), δkept)
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
