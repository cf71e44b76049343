"""Stage 3 once more: replay the walk of ``composite`` and add up, per primitive, what it contributes to a view.

Notation as in ``composite.py``; for primitive i, at a pixel,
    T, α, c    transmittance in front of it, its α, its colour
    B          colour of the image that lies behind it, background included
    d = T c - B / (1 - α)
               derivative of the image by α, per channel. The image is affine in α: d is exact for changes of any size.
               Without the second term where α < 0 and transmittance ignores negative α
    J = o Σ d  Σ over the channels, o the opacity: the derivative of the summed image by the kernel's value. As Speedy-
               Splat defines it: not limited where o times that value exceeds .99, 0 where |α| < 1/255 or the walk
               had ended before. Of a DoG primitive: by the value of the primary kernel
    D = α d    the image minus the image without the primitive, per channel

J and D are footprint images, one or three channels F each, and a pass adds up sums over their pixels.

Without a primitive some walks would end later; D puts the background there. That errs by up to T_end / (1 - α), where
T_end is what the walk left: little, unless the primitive is nearly opaque itself. Measured against real removals on a
trained model (fern, 10,000 primitives, 1,500 steps), the sum of D² is off by 5e-6 (median), at most 0.8 % for 99 % of
the primitives, 5 % for the worst of 400. Walks that went on to 1e-6 had a worst of 2 %.

Rounding: B is what remains of the finished image after everything in front was subtracted, off by 1e-7 of the image
at most; since T (1 - α) never falls below 1e-4, d has an error of 1e-3 T in the worst case, 1e-7 in the usual one.

Differences of neighbouring pixels need both in one lane: blocks and tiles then overlap by a column and a row
(``Blocks.overlap``), which are composited in both.
"""

# Dr.Jit's stubs give detached types as "object" and loop state as a tuple of one: argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAssignmentType=false, reportGeneralTypeIssues=false
from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr

from .composite_derivatives import add_row, sum_rows
from .frozen import frozen
from .geometry import Blocks, Grid
from .tables import FEATURES, Tables
from .tiles import Lists
from .walk import Settings, Walk


@dataclass(frozen=True)
class Sums:
    """Which sums over the pixels of the footprint images F a pass adds up, each a column of the result, in this order.

    removal: F is D. Else F is J.
    energy: Σ F²
    weighted: ... Σ (w F)² instead, with a plane w
    gradient: Σ |∇F|², ∇ the forward differences of neighbouring pixels that are both inside the image. That is the
        spectrum of F, continued by reflection, weighted by 4 sin²(ω_x/2) + 4 sin²(ω_y/2): |ω|² for small ω
    probes: that many columns Σ ξ F, with a plane ξ per column and channel of F
    """

    removal: bool = False
    energy: bool = True
    weighted: bool = False
    gradient: bool = False
    probes: int = 0

    @property
    def channels(self) -> int:
        """Of F."""
        return 3 if self.removal else 1

    @property
    def columns(self) -> int:
        return self.energy + self.gradient + self.probes

    @property
    def row_size(self) -> int:
        """Floats per entry of the lists: the columns and padding up to a power of two, for packet loads and stores."""
        return max(4, 1 << (self.columns - 1).bit_length())

    @property
    def blocks(self) -> Blocks:
        """The backend's blocks, with the overlap that differences of neighbours need."""
        blocks = Blocks.of_backend()
        if not self.gradient:
            return blocks
        return replace(blocks, width=blocks.width + 1, height=blocks.height + 1, overlap=1)


@frozen
def composite_score(
    grid: Grid, lanes: tuple, tables: Tables, lists: Lists, settings: Settings, sums: Sums,
    image: list, planes: list, entries, in_turn: bool, share=None,
) -> list:  # fmt: skip
    """Sums over a view, per primitive.

    Args:
        grid: made of ``sums.blocks``; the lists must be those of this grid.
        image: the 3 planes of the view [H*W], background included.
        planes: if ``sums.weighted``, w; then ξ of each probe, ``sums.channels`` planes each.
        entries: [entries, sums.row_size] zeros, as many as ``lists`` has entries.
        in_turn: ``lanes_add_in_turn``.
        share: [N], what is blended is share α, the image being made so: F is then D per share, that is the derivative
            of the image by the share, also where it is 0 (needs ``sums.removal``). None: 1 for all.

    Returns the columns, [N] each. As in ``composite_backward`` each entry has a row of its own, and so the result has
    the same bits in every run.
    """
    walk = Walk(grid, lanes, tables, lists, settings)
    width, channels = walk.blocks.width, range(sums.channels)
    own = [r * width + c for r in range(walk.blocks.stride_y) for c in range(walk.blocks.stride_x)]
    behind = [walk.read(plane) for plane in image]
    if not sums.removal:
        behind = [[r + g + b for r, g, b in zip(*behind, strict=True)]]
    values = [walk.read(plane) for plane in planes]
    weight2 = [w * w for w in values.pop(0)] if sums.weighted else None
    # ξ at the lane's own pixels, in the order in which F is listed
    probes = [[values[p * len(channels) + f][k] for f in channels for k in own] for p in range(sums.probes)]

    def energy(F: list):
        total = walk.Float(0)
        for f in channels:
            for k in own:
                total = dr.fma(F[f][k] if weight2 is None else F[f][k] * weight2[k], F[f][k], total)
        return total

    def gradient_energy(F: list):
        total = walk.Float(0)
        for f in channels:
            for k in own:
                for neighbour in (k + 1, k + width):
                    difference = dr.select(walk.inside[neighbour], F[f][neighbour] - F[f][k], 0)
                    total = dr.fma(difference, difference, total)
        return total

    def correlation(probe: list, F: list):
        total = walk.Float(0)
        for ξ, value in zip(probe, (F[f][k] for f in channels for k in own), strict=True):
            total = dr.fma(ξ, value, total)
        return total

    def body(at, T, behind):
        T, behind = list(T), [list(plane) for plane in behind]
        for _ in range(walk.blocks.unroll):
            isect, active, at = walk.next(at)
            splat, row, dx, dy = walk.fetch(isect, active)
            entry = dr.gather(walk.UInt, lists.entry_from_isect, isect, active)
            alpha, *_ = walk.alphas(splat, row, active, dx, dy)
            color, opacity = row[FEATURES : FEATURES + 3], dr.exp2(row[5])
            color = color if sums.removal else [sum(color)]
            blends = 1 if share is None else dr.gather(walk.Float, share, splat, active)
            F = [[] for _ in channels]
            for k in range(walk.pixels):
                a, blended_alpha = alpha[k], alpha[k] * blends
                weight, T_behind, go = walk.advance(blended_alpha, T[k])
                weight = dr.select(go, weight, 0)
                blended = go & (a != 0)
                for f in channels:
                    behind[f][k] = dr.fma(-weight, color[f], behind[f][k])
                    hidden = walk.hidden(behind[f][k], a, blended_alpha)
                    d = dr.select(blended, dr.fma(T[k], color[f], -hidden), 0)
                    F[f].append((a if sums.removal else opacity) * d)
                T[k] = T_behind
            result = ([energy(F)] if sums.energy else []) + ([gradient_energy(F)] if sums.gradient else [])
            result += [correlation(probe, F) for probe in probes]
            add_row(walk, entries, entry, result, sums.row_size, active, in_turn)
        return at, T, behind

    dr.while_loop(
        (walk.start(), walk.start_T(), behind),
        lambda at, T, behind: walk.more(at) & walk.alive(T),
        body,
        labels=("at", "T", "behind"),
        label="composite_score",
    )
    return sum_rows(walk, entries, sums.row_size, sums.columns)
