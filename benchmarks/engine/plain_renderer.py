"""A renderer from which everything optional was taken out by hand: what the engine is measured against.

It knows plain Gaussians of constant colour. There is no DoG, no view-dependent colour, no background, depth or
antialiasing, no mode and no cutoff to choose: nothing to leave out, because it was never there. With the engine it
shares what has no options (camera, rotation, tile lists, sums over isects). The formulas are those of ``project.py``,
``screen_kernels.py``, ``walks/walk.py`` and ``walks/adjoints.py``, and explained there; ``tests/engine/test_lean.py``
shows that kernels of both consist of the same instructions.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
from mi_dogsplat.engine.activations import rotation_matrix, softplus
from mi_dogsplat.engine.arrays import array_types, detached
from mi_dogsplat.engine.device_camera import DeviceCamera
from mi_dogsplat.engine.geometry import Blocks, Cutoffs, Grid
from mi_dogsplat.engine.project import Projection
from mi_dogsplat.engine.rows import read_rows, rows
from mi_dogsplat.engine.screen_kernels import LOG2_E, LOW_PASS, MAX_AXIS, Kernels, in_unit
from mi_dogsplat.engine.tiles import TileLists, tiles
from mi_dogsplat.engine.walks.pixels import planes_of
from mi_dogsplat.engine.walks.slot_rows import columns_of, lanes_add_in_turn
from mi_dogsplat.scene.sh_basis import C0

from .plain_walk import ROW, composite, composite_backward


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
    longest = [MAX_AXIS / length for length in lengths]
    scales = [dr.select(s <= limit, s, limit) for s, limit in zip(scales, longest, strict=True)]
    v0 = [a * s for a, s in zip(axes[0], scales, strict=True)]
    v1 = [a * s for a, s in zip(axes[1], scales, strict=True)]
    xx = v0[0] * v0[0] + v0[1] * v0[1] + v0[2] * v0[2]
    yy = v1[0] * v1[0] + v1[1] * v1[1] + v1[2] * v1[2]
    xy = v0[0] * v1[0] + v0[1] * v1[1] + v0[2] * v1[2]
    m0, m1, m2 = v0[1] * v1[2] - v0[2] * v1[1], v0[2] * v1[0] - v0[0] * v1[2], v0[0] * v1[1] - v0[1] * v1[0]
    det = m0 * m0 + m1 * m1 + m2 * m2 + LOW_PASS * (xx + yy) + LOW_PASS * LOW_PASS
    xx, yy = xx + LOW_PASS, yy + LOW_PASS
    det, unit = in_unit(det)
    ux = dr.sqrt(0.5 * LOG2_E * yy * unit / det)
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
