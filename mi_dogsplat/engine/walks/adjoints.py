"""Adjoints of what *composite* blends, given those of its planes: the walk once more.

Notation as in ``composite.py``, and
    δx     adjoint of x

The walk is replayed in the same order, and nothing is stored per primitive and pixel: it needs two numbers per pixel, T
and the part of δC·C that is still to come.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from ..arrays import if_stmt
from ..bands import PreparedView, WalkableView
from ..cuts import by_plane
from ..frozen import frozen
from ..geometry import MAX_ALPHA
from ..project import LN2
from ..slopes import CHANNELS
from ..tables import N_PSEUDO, CentredKernel, varying_columns
from .block_sums import curvature_adjoints, kernel_adjoints, plane_adjoints
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
            δ = CentredKernel(*kernel_adjoints(δp, kernel.ux, kernel.uy, kernel.vy, dx, dy, blocks))
            rows.add(slot, [*δ[-N_PSEUDO:]], True)
            return δ.x, δ.y

        return if_stmt((slot, alphas.dog_row, dx, dy, δp), alphas.is_dog, add, lambda *_: (Float(0), Float(0)))

    def slope_part(meeting: Meeting, δf: list, δby_column: list, δby_row: list, δrow: CentredKernel) -> tuple:
        """(δ of the row with what the centre does by way of the slopes, δ of the slopes)"""
        row, dx, dy = meeting.row, meeting.dx, meeting.dy
        δgx = [dr.fma(dx, δ, by) for δ, by in zip(δf, δby_column, strict=False)]
        δgy = [dr.fma(dy, δ, by) for δ, by in zip(δf, δby_row, strict=False)]
        for δ, gx, gy in zip(δf, row.slopes, row.slopes[CHANNELS:], strict=False):
            δrow = δrow._replace(x=dr.fma(-gx, δ, δrow.x), y=dr.fma(-gy, δ, δrow.y))  # dx, dy are from there
        return δrow, δgx + δgy

    def curvature_part(meeting: Meeting, δbrightness: list, δrow: CentredKernel) -> tuple:
        """The same of curvatures."""
        if not meeting.row.curvatures:
            return δrow, []
        δx, δy, *δq = curvature_adjoints(δbrightness, meeting.row.curvatures, meeting.dx, meeting.dy, blocks)
        return δrow.centre_plus(δx, δy), δq

    def cut_part(meeting: Meeting, alphas: Alphas, δp: list, δp_pseudo: list, δrow: CentredKernel) -> tuple:
        """The same of cuts: hx and hy of each plane."""
        both = [a + b for a, b in zip(δp, δp_pseudo, strict=True)] if δp_pseudo else δp
        δcuts = []
        for kept, (hx, hy) in zip(alphas.kept, by_plane(meeting.row.cuts), strict=True):
            δexponents = [δ * fall for δ, fall in zip(both, kept.falls, strict=True)]
            δx, δy, *δh = plane_adjoints(δexponents, hx, hy, meeting.dx, meeting.dy, blocks)
            δrow, δcuts = δrow.centre_plus(δx, δy), δcuts + δh
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
        δrow = CentredKernel(*kernel_adjoints(δp, kernel.ux, kernel.uy, kernel.vy, dx, dy, blocks))
        if pseudo_rows is not None:
            δrow = δrow.centre_plus(*pseudo_part(pseudo_rows, alphas, slot, dx, dy, δp_pseudo))
        δrow, δslopes = slope_part(meeting, δf, δby_column, δby_row, δrow)
        δrow, δq = curvature_part(meeting, δbrightness, δrow)
        δrow, δcuts = cut_part(meeting, alphas, δp, δp_pseudo, δrow)
        rows.add(slot, [*δrow, *δf, *δslopes, *δq, *δcuts], meeting.active)

    walk.run(step, rest, "composite_backward")
    return rows.sums(above=above), pseudo_rows.sums(view.tables.dog_index, pseudo_above) if pseudo_rows else []
