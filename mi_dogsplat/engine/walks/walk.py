"""How a lane walks down its list of primitives: what all kernels that blend, or replay the blending, have in common.

Notation as in ``composite.py``. A lane owns a block of pixels, unrolled here in Python; the lanes of a packet are one
tile, each with the isects of the tile's list that touch its block (``tiles.py``). How kernels are evaluated at the
pixels of a block: ``kernel_values.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from operator import and_
from typing import Any

import drjit as dr

from ..arrays import array_types, if_stmt, while_loop
from ..bands import PreparedView
from ..curvatures import curved_by
from ..geometry import MAX_ALPHA, MAX_T
from ..rows import NO_ROW, read_row
from ..slopes import CHANNELS
from ..tables import (
    DEPTH_FEATURE,
    KERNEL_COLUMNS,
    PSEUDO_COLUMNS,
    KernelRow,
    SplatRow,
    columns_used,
    row_size,
    varying_columns,
)
from .exp2 import exp2
from .kept import Kept, all_kept, left_of
from .kernel_values import DEAD_PATCH, kernel_values
from .lane_list import AheadList, LaneList
from .pixels import BlockPixels

AVX512_LANES = 16  # of a tile; with AVX-512 there are twice the registers of AVX2 and SSE


@dataclass
class Meeting:
    """A primitive as a lane meets it on its list."""

    isect: Any
    active: Any  # whether there is one
    splat: Any
    row: SplatRow
    dx: Any  # from its centre to the first pixel of the block
    dy: Any


@dataclass
class Alphas:
    """Of a primitive at the pixels of a block."""

    values: list  # α
    kept: list[Kept]  # what each plane leaves of the next two; none in a model without cuts
    primary: list  # 2^p g
    pseudo: list | None  # 2^p' g, 0 for a plain primitive; None in a model without DoG, as are the next two
    dog_row: Any
    is_dog: Any
    whole: tuple[list, list | None]  # 2^p and 2^p' themselves


class Walk:
    """Trace-time helper: one lane's block of pixels walking its tile's list."""

    def __init__(self, view: PreparedView, dog: bool | None = None, blends_only: bool = False):
        """
        Args:
            dog: None: walk all tiles. True: those that have a DoG primitive; False: those that have none, with kernels
                that know no pseudo-Gaussian. Both need lists that tell (``TileLists.dog``).
            blends_only: nothing is added up over lanes, so that they may meet an isect in any order.
        """
        self.types = types = array_types()
        self.exp2: Callable[[Any], Any] = exp2 if types.is_llvm else dr.exp2
        self.tables, self.lists, self.settings = view.tables, view.lists, view.settings
        self.columns, self.row_size = columns_used(view.settings), row_size(view.settings)
        self.has_dog = view.tables.pseudo is not None and dog is not False
        # whether a negative α raises T; a model without DoG has none, and is not asked
        self.amplifies = view.settings.negative_transmittance or not self.has_dog
        self.blocks = view.grid.blocks
        tile = view.lanes.tile
        self.walked = True if dog is None else (dr.gather(types.UInt, view.lists.dog, tile) != 0) == dog
        # past a branch, or with sums, what is held for the next steps costs more than it saves
        # (docs/performance/kernels.md)
        self.hurries = blends_only and not self.has_dog
        self.unroll = self._unrolled(blends_only)
        its_list = AheadList if self.hurries else LaneList
        self.list = its_list(view.lists, tile, self.blocks.lanes_per_tile, self.walked)
        self.x0, self.y0 = types.Float(view.lanes.x) + 0.5, types.Float(view.lanes.y) + 0.5
        if types.is_llvm:
            self._align_stack()
        self.pixels = BlockPixels(view.grid, view.lanes)
        self.stop_depth = None if self.tables.stop_depth is None else self.pixels.read(self.tables.stop_depth)
        self.unended: list | None = None  # in a walk that hurries: T of this iteration as if it did not end

    def _unrolled(self, blends_only: bool) -> int:
        """How many primitives an iteration takes: the longer a step and the fewer the registers, the fewer, for each
        holds values for the others (docs/performance/kernels.md)."""
        is_short = not self.has_dog and (self.hurries or not varying_columns(self.settings))
        if is_short or not self.blocks.adapts:
            return self.blocks.unroll
        if self.has_dog and self.settings.cuts:
            return 2 if blends_only else 1
        return self.blocks.unroll if self.blocks.lanes_per_tile >= AVX512_LANES else 2

    def _align_stack(self) -> None:
        """Local memory that LLVM cannot optimise away, always 0, makes it align the stack to cache lines.

        Otherwise (LLVM 19) each of the vectors that do not fit the registers lies across two of them.
        """
        Float = self.types.Float
        scratch = dr.alloc_local(Float, 2, value=Float(0))
        scratch[self.list.begin & 1] = Float(self.list.begin >> 31)
        self.x0 = self.x0 + scratch[self.list.end_group & 1]

    # --- the walk ---

    def run(self, step: Callable[[Meeting, list, Any], None], state: Any, label: str, unroll: bool = True) -> Any:
        """Walk until the list ends, or no pixel transmits any more.

        Args:
            step: takes a primitive, T per pixel and ``state``, and replaces items of these two lists (or dictionaries).
            state: nested lists and dictionaries of arrays.
            unroll: take as many primitives per iteration as suit the backend and the length of a step; else one.

        Returns (T per pixel, state), T negative where the walk has ended.
        """

        def body(place, T, state):
            T, state = _copied(T), _copied(state)
            if self.hurries and self.stop_depth is None:
                self.unended = list(T)
            for _ in range(self.unroll if unroll else 1):
                meeting, place = self._next(place)
                step(meeting, T, state)
            return self.list.look_ahead(place), T, state

        # pixels beyond the border of the image are born dead, so that they end no walk late
        T = [dr.select(ok, self.types.Float(1), self.types.Float(-1)) for ok in self.pixels.inside]
        start = self.list.start(), T, state
        return while_loop(start, self._goes_on, body, label, ("place", "T", "state"))[1:]

    def _goes_on(self, place, T: list, state: Any):
        return self.list.goes_on(place) & self._alive(T)

    def _alive(self, T: list):
        """Some pixel still transmits: finished pixels carry -T, and so the sign is set in the bits that all share."""
        bits: Any = reduce(and_, (dr.reinterpret_array(self.types.Int, t) for t in T))
        return bits >= 0

    def _next(self, place) -> tuple[Meeting, tuple]:
        """The next primitive, and where the lane then is. Lanes that meet none get an empty kernel."""
        isect, active, place = self.list.next(place)
        splat = dr.gather(self.types.UInt, self.lists.splat_from_isect, isect, active)
        columns = read_row(self.tables.splats, splat, self.row_size, self.columns, active)
        row = SplatRow.of(columns, self.settings)
        row.kernel = row.kernel._replace(lo=dr.select(active, row.kernel.lo, 2 * DEAD_PATCH))
        return Meeting(isect, active, splat, row, self.x0 - row.x, self.y0 - row.y), place

    def slot(self, meeting: Meeting):
        """Where the isect's sums are, in a ``SlotRows``."""
        return dr.gather(self.types.UInt, self.lists.slot_from_isect, meeting.isect, meeting.active)

    # --- one primitive ---

    def offsets(self, meeting: Meeting) -> list[tuple]:
        """(dx, dy) from its centre to each pixel of the block."""
        width = self.blocks.width
        return [(meeting.dx + k % width, meeting.dy + k // width) for k in range(self.pixels.count)]

    def features(self, meeting: Meeting) -> list[list]:
        """What is blended of it, at each pixel of the block: [feature][pixel]."""
        row, (width, count) = meeting.row, (self.blocks.width, self.pixels.count)
        planes = [[feature] * count for feature in row.features]
        for c, (gx, gy) in enumerate(zip(row.slopes[:CHANNELS], row.slopes[CHANNELS:], strict=True)):
            plane = []
            for k in range(0, count, width):
                first = dr.fma(gx, meeting.dx, dr.fma(gy, meeting.dy + k // width, row.features[c]))
                plane += [first, *(dr.fma(gx, column, first) for column in range(1, width))]
            planes[c] = plane
        if row.curvatures:
            more = [curved_by(row.curvatures, x, y) for x, y in self.offsets(meeting)]
            for c in range(CHANNELS):
                planes[c] = [color + brighter for color, brighter in zip(planes[c], more, strict=True)]
        return planes

    def alphas(self, meeting: Meeting) -> Alphas:
        """α, and what it is made of."""
        primary = self._kernel(meeting.row.kernel, meeting.dx, meeting.dy)
        pseudo, dog_row, is_dog = self._pseudo_kernel(meeting) if self.has_dog else (None, None, None)
        block = meeting.dx, meeting.dy, self.blocks, self.settings.patch, self.exp2
        kept, whole = all_kept(meeting.row.cuts, *block), (primary, pseudo)
        primary, pseudo = left_of(primary, kept), None if pseudo is None else left_of(pseudo, kept)
        return Alphas(self._alphas_of(primary, pseudo), kept, primary, pseudo, dog_row, is_dog, whole)

    def alphas_without(self, alphas: Alphas, plane: int) -> list:
        """α of the primitive without what a plane takes away, as it is where there is no such plane."""
        kept = [kept for k, kept in enumerate(alphas.kept) if k != plane]
        primary, pseudo = alphas.whole
        return self._alphas_of(left_of(primary, kept), None if pseudo is None else left_of(pseudo, kept))

    def _alphas_of(self, primary: list, pseudo: list | None) -> list:
        if pseudo is None:
            return self.primary_alphas(primary)
        alpha = []
        for v, v_p in zip(primary, pseudo, strict=True):
            a = dr.minimum(v, MAX_ALPHA) - dr.minimum(v_p, MAX_ALPHA)
            alpha.append(dr.select(dr.abs(a) >= self.settings.cutoffs.alpha, a, 0))
        return alpha

    def primary_alphas(self, primary: list) -> list:
        """α of a primitive without a pseudo-Gaussian, from its ``Alphas.primary``."""
        return [dr.select(v >= self.settings.cutoffs.alpha, dr.minimum(v, MAX_ALPHA), 0) for v in primary]

    def _kernel(self, kernel: KernelRow, dx, dy) -> list:
        return kernel_values(kernel, dx, dy, self.blocks, self.settings.patch, self.exp2)

    def _pseudo_kernel(self, meeting: Meeting) -> tuple:
        """2^p' of the pseudo-Gaussian, zeros for a plain primitive: packets without a DoG primitive jump over it."""
        row = dr.gather(self.types.UInt, self.tables.dog_row, meeting.splat, meeting.active)
        is_dog = meeting.active & (row != NO_ROW)

        def evaluate(row, dx, dy):
            return self._kernel(self.pseudo_row(row), dx, dy)

        values = if_stmt((row, meeting.dx, meeting.dy), is_dog, evaluate, lambda *_: self.pixels.zeros())
        return list(values), row, is_dog

    def pseudo_row(self, row) -> KernelRow:
        return KernelRow(*read_row(self.tables.pseudo, row, PSEUDO_COLUMNS, KERNEL_COLUMNS))

    def advance(self, alpha, T, meeting: Meeting, k: int) -> tuple:
        """Walk past a primitive at pixel ``k`` of the block: (weight α T of the primitive, T behind it, or -T where the
        walk has ended, whether it goes on)."""
        # Where no α is negative, T goes on to fall below the limit behind an end. So the next primitive need not wait
        # for the comparison: its weight is the same, or is not used.
        light = T if self.unended is None else self.unended[k]
        weight = alpha * light
        behind = light - (weight if self.amplifies else dr.maximum(weight, 0))
        goes_on = behind >= self.settings.cutoffs.transmittance
        if self.has_dog and self.settings.negative_transmittance:  # T may rise
            goes_on &= behind <= MAX_T
        if self.stop_depth is not None:
            goes_on &= meeting.row.features[DEPTH_FEATURE] <= self.stop_depth[k]
        if self.unended is not None:
            self.unended[k] = behind
        return weight, dr.select(goes_on, behind, -dr.abs(T)), goes_on

    def hidden(self, behind, alpha, blended_alpha):
        """By how much a primitive dims the light ``behind`` it, per unit of α: the image's derivative is T c - this."""
        light = behind / (1 - blended_alpha)  # as it would be without the primitive
        return light if self.amplifies else dr.select(alpha > 0, light, 0)


def _copied(state: Any) -> Any:
    """Lists and dictionaries of their own, of the same arrays."""
    if isinstance(state, dict):
        return {name: _copied(value) for name, value in state.items()}
    return [_copied(value) for value in state] if isinstance(state, list) else state
