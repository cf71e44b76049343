"""The walks of ``plain_renderer.py``: blending and its derivatives, for plain Gaussians of constant colour alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from operator import and_
from typing import Any

import drjit as dr
import mitsuba as mi
from mi_dogsplat.engine.arrays import array_types, while_loop
from mi_dogsplat.engine.frozen import frozen
from mi_dogsplat.engine.geometry import MAX_ALPHA, Grid, Lanes
from mi_dogsplat.engine.screen_kernels import LN2
from mi_dogsplat.engine.tables import KernelRow
from mi_dogsplat.engine.tiles import WORD, TileLists
from mi_dogsplat.engine.walks.block_sums import kernel_adjoints
from mi_dogsplat.engine.walks.exp2 import exp2
from mi_dogsplat.engine.walks.kernel_values import DEAD_PATCH
from mi_dogsplat.engine.walks.slot_rows import SlotRows

ALPHA_MIN, T_MIN = 1 / 255, 1e-4
ROW = 16  # x y ux uy vy lo q s t, colour, padding


class Lane:
    """A lane's block of pixels (one patch), and the primitives that it meets."""

    def __init__(self, grid: Grid, lanes: Lanes, table, lists: TileLists):
        types = array_types()
        self.Float, self.Int, self.UInt, self.Quad, self.Floats = (
            types.Float, types.Int, types.UInt, types.Quad, types.Floats
        )  # fmt: skip
        self.grid, self.table, self.lists = grid, table, lists
        self.width, self.height, self.unroll = grid.blocks.width, grid.blocks.height, grid.blocks.unroll
        self.pixels = self.width * self.height
        self.exp2: Callable[[Any], Any] = exp2 if types.is_llvm else dr.exp2
        tile, x, y = lanes.tile, lanes.x, lanes.y
        self.tile, self.lane = tile, dr.arange(self.UInt, dr.width(tile)) % grid.blocks.lanes_per_tile
        self.begin, end = dr.gather(self.UInt, lists.begin, tile), dr.gather(self.UInt, lists.end, tile)
        self.end = dr.select(self.begin < end, end, 0)
        self.last = (self.end + (WORD - 1)) // WORD
        self.x0, self.y0 = self.Float(x) + 0.5, self.Float(y) + 0.5
        if types.is_llvm:
            scratch = dr.alloc_local(self.Float, 2, value=self.Float(0))
            scratch[self.begin & 1] = self.Float(self.begin >> 31)
            self.x0 = self.x0 + scratch[self.last & 1]
        in_column = [(x + k) < lanes.width for k in range(self.width)]
        in_row = [(y + k) < lanes.height for k in range(self.height)]
        self.inside = [r & c for r in in_row for c in in_column]
        first, columns = dr.fma(y, lanes.width, x), range(self.width)
        self.at = [dr.fma(lanes.width, r, first + c) for r in range(self.height) for c in columns]
        self.start_T = [dr.select(ok, self.Float(1), self.Float(-1)) for ok in self.inside]

    def read(self, plane) -> list:
        return [dr.gather(self.Float, plane, at, ok) for at, ok in zip(self.at, self.inside, strict=True)]

    def write(self, planes: list[list]) -> list[mi.Float]:
        target = dr.empty(self.Float, 4 * self.grid.width * self.grid.height)
        for k, (at, ok) in enumerate(zip(self.at, self.inside, strict=True)):
            dr.scatter(target, self.Quad([values[k] for values in planes]), at, ok, mode=dr.ReduceMode.Permute)
        return [target]

    def start(self) -> tuple:
        return self.UInt(0), self.begin // WORD

    def more(self, at):
        bits, group = at
        return (bits != 0) | (group < self.last)

    def goes_on(self, at, T: list):
        signs: Any = reduce(and_, (dr.reinterpret_array(self.Int, t) for t in T))
        return self.more(at) & (signs >= 0)

    def word(self, group, active):
        index = (self.tile + group) * self.grid.blocks.lanes_per_tile + self.lane
        return dr.gather(self.UInt, self.lists.words, index, active)

    def next(self, at) -> tuple:
        bits, group = at
        refill = (bits == 0) & (group < self.last)
        word = self.word(group, refill)
        bits, group = dr.select(refill, word, bits), dr.select(refill, group + 1, group)
        return dr.fma(group - 1, WORD, dr.tzcnt(bits)), bits != 0, (bits & (bits - 1), group)

    def fetch(self, isect, active) -> tuple:
        splat = dr.gather(self.UInt, self.lists.splat_from_isect, isect, active)
        eight = dr.gather(self.Floats, self.table, splat * (ROW // 8), active, shape=(8, dr.width(splat)))
        row = [*eight, *dr.gather(self.Quad, self.table, dr.fma(splat, ROW // 4, 2), active)]
        row[5] = dr.select(active, row[5], 2 * DEAD_PATCH)
        return row, self.x0 - row[0], self.y0 - row[1]

    def gaussian(self, row: list, dx, dy) -> list:
        ux, uy, vy, lo, q, s, t = row[2:9]
        u, v = dr.fma(ux, dx, uy * dy), vy * dy
        p = dr.fma(-u, u, dr.fma(-v, v, lo))
        live = p > DEAD_PATCH
        first = dr.select(live, self.exp2(p), 0)
        right = self.exp2(dr.select(live, -ux * dr.fma(2, u, ux), 0))
        down = self.exp2(dr.select(live, dr.fma(-uy, dr.fma(2, u, uy), -vy * dr.fma(2, v, vy)), 0))
        values = []
        for _ in range(self.height):
            value, ratio = first, right
            for _ in range(self.width):
                values.append(value)
                value, ratio = value * ratio, ratio * q
            first, right, down = first * down, right * s, down * t
        return values

    def blend(self, value, T, light) -> tuple:
        """(α, weight, T behind, the same as if the walk had not ended, whether it is blended)."""
        alpha = dr.select(value >= ALPHA_MIN, dr.minimum(value, MAX_ALPHA), 0)
        weight = alpha * light
        behind = light - weight
        go = behind >= T_MIN
        return alpha, weight, dr.select(go, behind, -dr.abs(T)), behind, go


class AheadLane(Lane):
    """The same with words that are read an iteration ahead (``engine/walks/lane_list.py``)."""

    def start(self) -> tuple:
        group = self.begin // WORD
        word, first = self.word(group, group < self.last), group * WORD
        return self.look_ahead((word, first, self.UInt(0), first + WORD))

    def more(self, at):
        bits, _, ahead, following = at
        return ((bits | ahead) != 0) | (following < self.end)

    def next(self, at) -> tuple:
        bits, base, ahead, following = at
        empty = bits == 0
        bits = dr.select(empty, ahead, bits)
        base = dr.select(empty, following - WORD, base)
        return base + dr.tzcnt(bits), bits != 0, (bits & (bits - 1), base, dr.select(empty, 0, ahead), following)

    def look_ahead(self, at) -> tuple:
        bits, base, ahead, following = at
        taken = (ahead == 0) & (following < self.end)
        word = self.word(following // WORD, taken)
        return bits, base, dr.select(taken, word, ahead), dr.select(taken, following + WORD, following)


@frozen
def composite(grid: Grid, lanes: Lanes, table, lists: TileLists) -> list:
    lane = AheadLane(grid, lanes, table, lists)

    def body(at, T, C):
        T, C, light = list(T), list(C), list(T)
        for _ in range(lane.unroll):
            isect, active, at = lane.next(at)
            row, dx, dy = lane.fetch(isect, active)
            for k, value in enumerate(lane.gaussian(row, dx, dy)):
                _, weight, T[k], light[k], go = lane.blend(value, T[k], light[k])
                for c in range(3):
                    color = C[c * lane.pixels + k]
                    C[c * lane.pixels + k] = dr.select(go, dr.fma(weight, row[9 + c], color), color)
        return lane.look_ahead(at), T, C

    start = lane.start(), lane.start_T, [lane.Float(0)] * (3 * lane.pixels)
    _, T, C = while_loop(start, lambda at, T, C: lane.goes_on(at, T), body, "plain", ("at", "T", "C"))
    planes = [C[c * lane.pixels : (c + 1) * lane.pixels] for c in range(3)]
    return lane.write([*planes, [dr.abs(t) for t in T]])


@frozen
def composite_backward(
    grid: Grid, lanes: Lanes, table, lists: TileLists, colors: list, T_final, δcolors: list, in_turn: bool
) -> list:
    lane, rows = Lane(grid, lanes, table, lists), SlotRows(lists, 9, in_turn)
    δC = [lane.read(plane) for plane in δcolors]
    rest = [lane.Float(0)] * lane.pixels
    for plane, δ in zip(colors, δC, strict=True):
        rest = [dr.fma(c, d, r) for c, d, r in zip(lane.read(plane), δ, rest, strict=True)]

    def body(at, T, rest):
        T, rest = list(T), list(rest)
        for _ in range(lane.unroll):
            isect, active, at = lane.next(at)
            row, dx, dy = lane.fetch(isect, active)
            slot = dr.gather(lane.UInt, lists.slot_from_isect, isect, active)
            δp, δf = [], [lane.Float(0)] * 3
            for k, value in enumerate(lane.gaussian(row, dx, dy)):
                alpha, weight, behind, _, go = lane.blend(value, T[k], T[k])
                weight = dr.select(go, weight, 0)
                c = row[9] * δC[0][k]
                for f in range(3):
                    δf[f] = dr.fma(weight, δC[f][k], δf[f])
                    if f:
                        c = dr.fma(row[9 + f], δC[f][k], c)
                rest[k] = dr.fma(-weight, c, rest[k])
                δα = LN2 * dr.fma(T[k], c, -(rest[k] / (1 - alpha)))
                δα = dr.select(go & (alpha != 0), δα, 0)
                δp.append(dr.select(value < MAX_ALPHA, δα * value, 0))
                T[k] = behind
            rows.add(slot, [*kernel_adjoints(δp, KernelRow(*row[2:9]), dx, dy, grid.blocks), *δf], active)
        return at, T, rest

    start = lane.start(), lane.start_T, rest
    while_loop(start, lambda at, T, rest: lane.goes_on(at, T), body, "plain backward", ("at", "T", "rest"))
    return rows.sums()
