"""A renderer from which everything optional was taken out by hand: what the engine is measured against.

It knows plain Gaussians of constant colour. There is no DoG, no view-dependent colour, no background, depth or
antialiasing, no mode and no cutoff to choose: nothing to leave out, because it was never there. With the engine it
shares what has no options (camera, rotation, tile lists, sums over isects). The formulas are those of ``project.py``,
``walks/walk.py`` and ``walks/derivatives.py``, and explained there; ``tests/engine/test_lean.py`` shows that kernels of
both consist of the same instructions.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from operator import and_
from typing import Any

import drjit as dr
import mitsuba as mi
from mi_dogsplat.engine.arrays import array_types, detached, while_loop
from mi_dogsplat.engine.frozen import frozen
from mi_dogsplat.engine.geometry import Blocks, Cutoffs, Grid, Lanes
from mi_dogsplat.engine.project import (
    LOG2_E,
    LOW_PASS,
    MAX_AXIS,
    DeviceCamera,
    Kernels,
    Projection,
    rotation_matrix,
    rows,
    softplus,
)
from mi_dogsplat.engine.sh import read_rows
from mi_dogsplat.engine.tiles import WORD, TileLists, tiles
from mi_dogsplat.engine.walks.derivatives import LN2
from mi_dogsplat.engine.walks.exp2 import exp2
from mi_dogsplat.engine.walks.pixels import planes_of
from mi_dogsplat.engine.walks.slot_rows import SlotRows, columns_of, lanes_add_in_turn
from mi_dogsplat.engine.walks.walk import ALPHA_MAX, DEAD_PATCH
from mi_dogsplat.scene.sh_basis import C0

ALPHA_MIN, T_MIN = 1 / 255, 1e-4
ROW = 16  # x y ux uy vy lo q s t, colour, padding


def render(params: dict, camera: DeviceCamera) -> tuple[list, mi.Float]:
    """Planes of the three channels and of T, of parameters as ``upload`` makes them from a model of SH degree 0."""
    grid, _, table, lists = prepare(params, camera)
    *colors, T = planes_of(composite(grid, grid.lanes, table, lists), 4)
    return colors, T


def backward(params: dict, camera: DeviceCamera, δcolors: list) -> None:
    """Render, and accumulate the gradients of the parameters given those of the three planes."""
    grid, projection, table, lists = prepare(params, camera)
    *colors, T = planes_of(composite(grid, grid.lanes, table, lists), 4)
    δsplats = composite_backward(grid, grid.lanes, table, lists, colors, T, δcolors, lanes_add_in_turn(mi.variant()))
    δsplats = columns_of(δsplats, lists, 9)
    k = projection.kernels
    splats = [projection.x, projection.y, k.ux, k.uy, k.vy, k.lo, *projection.colors]
    for value, δ in zip(splats, δsplats, strict=True):
        dr.set_grad(value, mi.Float(δ))
    dr.enqueue(dr.ADMode.Backward, splats)
    dr.traverse(dr.ADMode.Backward)


def prepare(params: dict, camera: DeviceCamera) -> tuple[Grid, Projection, Any, TileLists]:
    grid = Grid.of(camera.width, camera.height, Blocks.of_backend())
    projection = project(params, camera)
    return grid, projection, pack(projection), tiles(projection, grid, Cutoffs())


def project(params: dict, camera: DeviceCamera) -> Projection:
    index = dr.arange(mi.UInt32, dr.width(params["logit_opacities"]))
    W = camera.rotation
    offset = zip(rows(params["means"], 3, index), camera.position, camera.position_rest, strict=True)
    to_mean = [(mean - position) - rest for mean, position, rest in offset]
    px, py, depth = (dr.fma(W[r][0], to_mean[0], dr.fma(W[r][1], to_mean[1], W[r][2] * to_mean[2])) for r in range(3))
    visible = (depth > camera.near_clip) & (depth < camera.far_clip)
    inv_z = dr.rcp(dr.select(visible, depth, 1))
    u, v = px * inv_z, py * inv_z
    x, y = dr.fma(camera.fx, u, camera.cx), dr.fma(camera.fy, v, camera.cy)
    left, right, top, bottom = camera.limits
    u, v = dr.clip(u, -left, right), dr.clip(v, -top, bottom)
    jx, jy = camera.fx * inv_z, camera.fy * inv_z
    JW = [
        [jx * (W[0][c] - u * W[2][c]) for c in range(3)],
        [jy * (W[1][c] - v * W[2][c]) for c in range(3)],
    ]
    quats, log_scales = read_rows(params["quats"], 4, 4, index), rows(params["log_scales"], 3, index)
    R = rotation_matrix(quats)
    axes = [[JW[r][0] * R[0][c] + JW[r][1] * R[1][c] + JW[r][2] * R[2][c] for c in range(3)] for r in range(2)]
    kernels = screen_kernels(axes, [dr.exp(s) for s in log_scales], -LOG2_E * softplus(-params["logit_opacities"]))
    finite = [x, y, kernels.ux, kernels.uy, *log_scales, *quats]
    visible &= all_finite(finite) & ~dr.isnan(kernels.lo)
    dc = read_rows(params["sh_coeffs"], 3, 3, index, visible)
    radiance = [dr.fma(C0, c, mi.Float(0.5)) for c in dc]
    visible &= all_finite(radiance)
    return Projection(x, y, depth, kernels, [dr.maximum(c, 0) for c in radiance], visible, None, None, None)


def all_finite(values: list) -> mi.Bool:
    finite = dr.isfinite(values[0])
    for value in values[1:]:
        finite &= dr.isfinite(value)
    return finite


def screen_kernels(axes: list, scales: list, log2_opacity) -> Kernels:
    lengths = [dr.maximum(abs(dr.detach(x)), abs(dr.detach(y))) for x, y in zip(*axes, strict=True)]
    scales = [dr.minimum(s, MAX_AXIS / length) for s, length in zip(scales, lengths, strict=True)]
    v0 = [a * s for a, s in zip(axes[0], scales, strict=True)]
    v1 = [a * s for a, s in zip(axes[1], scales, strict=True)]
    xx = v0[0] * v0[0] + v0[1] * v0[1] + v0[2] * v0[2]
    yy = v1[0] * v1[0] + v1[1] * v1[1] + v1[2] * v1[2]
    xy = v0[0] * v1[0] + v0[1] * v1[1] + v0[2] * v1[2]
    m0, m1, m2 = v0[1] * v1[2] - v0[2] * v1[1], v0[2] * v1[0] - v0[0] * v1[2], v0[0] * v1[1] - v0[1] * v1[0]
    det = m0 * m0 + m1 * m1 + m2 * m2 + LOW_PASS * (xx + yy) + LOW_PASS * LOW_PASS
    xx, yy = xx + LOW_PASS, yy + LOW_PASS
    ux = dr.sqrt(0.5 * LOG2_E * yy / det)
    return Kernels(ux, -ux * xy / yy, dr.sqrt(0.5 * LOG2_E / yy), log2_opacity, xx, yy)


def pack(projection: Projection) -> mi.Float:
    k = projection.kernels
    ratios = [dr.exp2(-2 * r) for r in (k.ux * k.ux, k.ux * k.uy, dr.fma(k.uy, k.uy, k.vy * k.vy))]
    columns = [projection.x, projection.y, k.ux, k.uy, k.vy, k.lo, *ratios, *projection.colors]
    columns = detached(columns)
    n = dr.width(columns[0])
    table, index = dr.empty(array_types().Float, n * ROW), dr.arange(array_types().UInt, n)
    for c, column in enumerate(columns):
        dr.scatter(table, column, dr.fma(index, ROW, c), mode=dr.ReduceMode.Permute)
    return table


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
        in_column = [(x + k) < grid.width for k in range(self.width)]
        in_row = [(y + k) < grid.height for k in range(self.height)]
        self.inside = [r & c for r in in_row for c in in_column]
        self.at = [y * grid.width + x + (r * grid.width + c) for r in range(self.height) for c in range(self.width)]
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
        alpha = dr.select(value >= ALPHA_MIN, dr.minimum(value, ALPHA_MAX), 0)
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

    def moments(δp: list, ux, uy, vy, dx, dy) -> list:
        m0 = mk = mr = mkk = mkr = mrr = lane.Float(0)
        for r in range(lane.height):
            row = δp[r * lane.width : (r + 1) * lane.width]
            s0, sk, skk = row[0], lane.Float(0), lane.Float(0)
            for k, δ in enumerate(row[1:], 1):
                s0, sk, skk = s0 + δ, dr.fma(k, δ, sk), dr.fma(k * k, δ, skk)
            m0, mk, mkk = m0 + s0, mk + sk, mkk + skk
            if r:
                mr, mkr, mrr = dr.fma(r, s0, mr), dr.fma(r, sk, mkr), dr.fma(r * r, s0, mrr)
        u, v = dr.fma(ux, dx, uy * dy), vy * dy
        mu, mv = dr.fma(u, m0, dr.fma(ux, mk, uy * mr)), dr.fma(v, m0, vy * mr)
        mux = dr.fma(dx, mu, dr.fma(u, mk, dr.fma(ux, mkk, uy * mkr)))
        muy = dr.fma(dy, mu, dr.fma(u, mr, dr.fma(ux, mkr, uy * mrr)))
        mvy = dr.fma(dy, mv, dr.fma(v, mr, vy * mrr))
        return [2 * ux * mu, 2 * dr.fma(uy, mu, vy * mv), -2 * mux, -2 * muy, -2 * mvy, m0]

    def body(at, T, rest):
        T, rest = list(T), list(rest)
        for _ in range(lane.unroll):
            isect, active, at = lane.next(at)
            row, dx, dy = lane.fetch(isect, active)
            slot = dr.gather(lane.UInt, lists.slot_from_isect, isect, active)
            δp, δf, (ux, uy, vy) = [], [lane.Float(0)] * 3, row[2:5]
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
                δp.append(dr.select(value < ALPHA_MAX, δα * value, 0))
                T[k] = behind
            rows.add(slot, moments(δp, ux, uy, vy, dx, dy) + δf, active)
        return at, T, rest

    start = lane.start(), lane.start_T, rest
    while_loop(start, lambda at, T, rest: lane.goes_on(at, T), body, "plain backward", ("at", "T", "rest"))
    return rows.sums()
