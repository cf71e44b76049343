"""Adjoints of what *composite* blends, given those of its planes: the walk once more.

Notation as in ``composite.py``, and
    δx     adjoint of x

C = Σ c α T is affine in the α of a primitive: all that lies behind it has the factor 1 - α. So

    δα = T (δC·c) - R / (1 - α),   R = δC·C + δT T_end, less the parts α T (δC·c) of it and of those in front

and δc = α T δC, δp = ln 2 2^p δα. The walk is replayed in the same order, and nothing is stored per primitive and
pixel: it needs two numbers per pixel, T and R.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..arrays import if_stmt
from ..bands import PreparedView, WalkableView
from ..cuts import by_plane
from ..frozen import frozen
from ..geometry import MAX_ALPHA
from ..screen_kernels import LN2
from ..slopes import CHANNELS
from ..tables import N_PSEUDO, CentredKernel, varying_columns
from .block_sums import curvature_adjoints, dot, kernel_adjoints, plane_adjoints
from .pixels import Planes
from .slot_rows import SlotRows, columns_of, lanes_add_in_turn
from .walk import Alphas, Meeting, Walk


def composite_backward(view: WalkableView, blended: Planes, δ: Planes) -> tuple[list, list]:
    """Adjoints of the projected quantities, given those of the planes.

    Args:
        blended: what ``composite`` returned.
        δ: adjoints of it.

    Returns (δ of what a ``CentredKernel`` has, of each feature, and of what varies over primitives, [N] each;
    δ of the last ``N_PSEUDO`` of these of the pseudo-Gaussians, [M] each, nothing without DoG).
    """
    columns, dog_index = _columns(view), view.tables.dog_index
    in_turn = lanes_add_in_turn(mi.variant())

    def walk(band: PreparedView, above: tuple[list, list]) -> tuple[list, list]:
        δsplats, δpseudo = _composite_backward(band, blended, δ, in_turn, *above)
        of_pseudo = [] if dog_index is None else columns_of(δpseudo, band.lists, N_PSEUDO, dog_index)
        return columns_of(δsplats, band.lists, columns), of_pseudo

    return view.walked(walk, ([], []))


def _columns(view: WalkableView) -> int:
    return len(CentredKernel._fields) + view.settings.n_features + varying_columns(view.settings)


@frozen
def _composite_backward(
    view: PreparedView, blended: Planes, δplanes: Planes, in_turn: bool, above: list, pseudo_above: list
) -> tuple[list, list]:
    walk = Walk(view)
    rows = SlotRows(view.lists, _columns(view), in_turn)
    pseudo_rows = SlotRows(view.lists, N_PSEUDO, in_turn) if walk.has_dog else None
    pixels = PixelAdjoints(walk, δplanes)

    def step(meeting: Meeting, T: list, rest: list) -> None:
        slot, colors, alphas = walk.slot(meeting), walk.features(meeting), walk.alphas(meeting)
        weights, δα = pixels.past(meeting, colors, alphas, T, rest)
        δf, moments, δbrightness = pixels.feature_sums(meeting, weights)
        δp = _of_exponents(alphas.primary, δα)
        δrow = kernel_adjoints(δp, meeting.row.kernel, meeting.dx, meeting.dy, walk.blocks)
        if pseudo_rows is not None and alphas.pseudo is not None:
            δp_pseudo = _of_exponents(alphas.pseudo, [-δ for δ in δα])
            δrow = δrow.centre_plus(*_pseudo_part(walk, pseudo_rows, meeting, alphas, slot, δp_pseudo))
            δp = [a + b for a, b in zip(δp, δp_pseudo, strict=True)]
        δrow, δslopes = _slope_part(meeting, δf, moments, δrow)
        δrow, δq = _curvature_part(walk, meeting, δbrightness, δrow)
        δrow, δcuts = _cut_part(walk, meeting, alphas, δp, δrow)
        rows.add(slot, [*δrow, *δf, *δslopes, *δq, *δcuts], meeting.active)

    walk.run(step, pixels.still_to_come(blended), "composite_backward")
    return rows.sums(above=above), pseudo_rows.sums(view.tables.dog_index, pseudo_above) if pseudo_rows else []


class PixelAdjoints:
    """Trace-time helper: adjoints at the pixels of a lane's block, as a walk goes past one primitive after another."""

    def __init__(self, walk: Walk, δplanes: Planes):
        self.walk, self.δplanes = walk, δplanes
        self.δC = [walk.pixels.read(plane) for plane in δplanes.features]
        width = walk.blocks.width
        self.column_of, self.row_of = zip(*((k % width, k // width) for k in range(walk.pixels.count)), strict=True)

    def still_to_come(self, blended: Planes) -> list:
        """R before the first primitive: all of δC·C + δT T_end."""
        read = self.walk.pixels.read
        rest = [δ * t for δ, t in zip(read(self.δplanes.T), read(blended.T), strict=True)]
        for plane, δ in zip(blended.features, self.δC, strict=True):
            rest = [dr.fma(c, d, r) for c, d, r in zip(read(plane), δ, rest, strict=True)]
        return rest

    def past(self, meeting: Meeting, colors: list, alphas: Alphas, T: list, rest: list) -> tuple[list, list]:
        """(weight α T, ln 2 δα) at each pixel; ``T`` and ``rest``, R, become those behind the primitive."""
        weights, δα = [], []
        for k, a in enumerate(alphas.values):
            weight, behind, goes_on = self.walk.advance(a, T[k], meeting, k)
            weight = dr.select(goes_on, weight, 0)
            c = colors[0][k] * self.δC[0][k]
            for color, δ in zip(colors[1:], self.δC[1:], strict=True):
                c = dr.fma(color[k], δ[k], c)
            rest[k] = dr.fma(-weight, c, rest[k])
            δ = LN2 * dr.fma(T[k], c, -self.walk.hidden(rest[k], a, a))
            # zero where the primitive was ignored, or the walk had ended
            δα.append(dr.select(goes_on & (a != 0), δ, 0))
            weights.append(weight)
            T[k] = behind
        return weights, δα

    def feature_sums(self, meeting: Meeting, weights: list) -> tuple[list, list, list]:
        """(δ of the features; Σ δ column and Σ δ row of each channel, where colours have slopes; δ of the brightness at
        each pixel, where it curves)"""
        moments, δbrightness = [], []
        for δplane in self.δC[:CHANNELS] if meeting.row.slopes else ():
            δcolors = [weight * δ for weight, δ in zip(weights, δplane, strict=True)]
            moments.append((dot(self.column_of, δcolors), dot(self.row_of, δcolors)))
        if meeting.row.curvatures:
            δbrightness = [weight * (r + g + b) for weight, r, g, b in zip(weights, *self.δC[:CHANNELS], strict=True)]
        return [dot(weights, δplane) for δplane in self.δC], moments, δbrightness


def _of_exponents(values: list, δα: list) -> list:
    """δp at each pixel, of 2^p g = ``values``: zero where it is limited to .99."""
    return [dr.select(value < MAX_ALPHA, δ * value, 0) for value, δ in zip(values, δα, strict=True)]


def _pseudo_part(walk: Walk, rows: SlotRows, meeting: Meeting, alphas: Alphas, slot, δp: list) -> tuple:
    """Add what is the pseudo-Gaussian's own to its row, in a branch as its kernel; returns δ of x, y."""
    Float = walk.types.Float

    def add(slot, dog_row, dx, dy, δp):
        δ = kernel_adjoints(δp, walk.pseudo_row(dog_row), dx, dy, walk.blocks)
        rows.add(slot, [*δ[-N_PSEUDO:]], True)
        return δ.x, δ.y

    of_lane = slot, alphas.dog_row, meeting.dx, meeting.dy, δp
    return if_stmt(of_lane, alphas.is_dog, add, lambda *_: (Float(0), Float(0)))


def _slope_part(meeting: Meeting, δf: list, moments: list, δrow: CentredKernel) -> tuple[CentredKernel, list]:
    """(δ of the row with what the centre does by way of the slopes, δ of the slopes)"""
    slopes, δgx, δgy = meeting.row.slopes, [], []
    for gx, gy, δ, (by_column, by_row) in zip(slopes[:CHANNELS], slopes[CHANNELS:], δf, moments, strict=False):
        δgx.append(dr.fma(meeting.dx, δ, by_column))
        δgy.append(dr.fma(meeting.dy, δ, by_row))
        δrow = δrow._replace(x=dr.fma(-gx, δ, δrow.x), y=dr.fma(-gy, δ, δrow.y))  # dx, dy are from there
    return δrow, δgx + δgy


def _curvature_part(walk: Walk, meeting: Meeting, δbrightness: list, δrow: CentredKernel) -> tuple[CentredKernel, list]:
    """The same of curvatures."""
    if not meeting.row.curvatures:
        return δrow, []
    δx, δy, *δq = curvature_adjoints(δbrightness, meeting.row.curvatures, meeting.dx, meeting.dy, walk.blocks)
    return δrow.centre_plus(δx, δy), δq


def _cut_part(
    walk: Walk, meeting: Meeting, alphas: Alphas, δp: list, δrow: CentredKernel
) -> tuple[CentredKernel, list]:
    """The same of cuts, hx and hy of each plane; ``δp``: of both kernels."""
    δcuts = []
    for kept, (hx, hy) in zip(alphas.kept, by_plane(meeting.row.cuts), strict=True):
        δexponents = [δ * fall for δ, fall in zip(δp, kept.falls, strict=True)]
        δx, δy, *δh = plane_adjoints(δexponents, hx, hy, meeting.dx, meeting.dy, walk.blocks)
        δrow, δcuts = δrow.centre_plus(δx, δy), δcuts + δh
    return δrow, δcuts
