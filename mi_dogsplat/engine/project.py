"""Stage 1, *project*: 3D primitives to 2D kernels on the image plane, one lane per primitive (EWA splatting).

Notation (Kerbl et al. 2023; method paper, Sec. 3)
    μ, R, s     centre, rotation, scales of a primitive; Σ = R S Sᵀ Rᵀ
    W, t        rotation and translation of the camera (OpenCV: x right, y down, z forward)
    J           Jacobian of the projection at the centre; of a pinhole evaluated inside 1.3 x the field of view,
                of parallel rays the same everywhere
    Σ'          screen covariance J W Σ Wᵀ Jᵀ + 0.3 I, in px², of which ``screen_kernels.py`` makes the kernel
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from ..scene.row_groups import CURVATURES, OWN_AXES, PLANES, SHIFTS, SLOPES, RowGroup
from .activations import all_finite, rotation_matrix, softplus
from .curvatures import curvatures_on_screen
from .cuts import COLUMNS as CUT_COLUMNS
from .cuts import by_plane, cut_on_screen
from .device_camera import DeviceCamera
from .own_axes import own_axes_per_pixel
from .rows import NO_ROW, read_rows, rows
from .screen_kernels import LOG2_E, Kernels, scales_in_range, screen_kernels
from .sh import evaluate_sh, unit
from .sh_groups import evaluate_groups, has_groups
from .shifts import ROW as SHIFT_ROW
from .shifts import VIEW_ROW, shift
from .slopes import slopes_on_screen


@dataclass
class Projection:
    """What the later stages need of N primitives; ``pseudo`` has one row per DoG primitive, or is None."""

    x: mi.Float  # centre in pixels
    y: mi.Float
    depth: mi.Float  # z in camera space
    kernels: Kernels
    colors: list  # 3 channels, max(0, SH + 0.5)
    visible: mi.Bool
    pseudo: Kernels | None
    dog_row: mi.UInt32 | None  # [N] row in ``pseudo`` or NO_ROW
    dog_index: mi.UInt32 | None  # [M] its inverse
    slopes: list | None = None  # of the colours: gx of 3 channels, then gy, per pixel; None without any
    curvatures: list | None = None  # of the brightness: qxx, qxy, qyy per square pixel; None without any
    cuts: list | None = None  # hx, hy of each plane, of what it leaves of the kernels, per pixel; None without any

    @property
    def varying(self) -> list:
        """What varies over primitives, as columns of the compositor's table: slopes, curvatures, cuts."""
        return [*(self.slopes or []), *(self.curvatures or []), *(self.cuts or [])]

    @property
    def planes(self) -> int:
        """How many may cut a primitive off."""
        return len(self.cuts or []) // CUT_COLUMNS


def _through_pinhole(camera: DeviceCamera, W: list, position: list, visible) -> tuple:
    """(x, y, J W as two rows) of centres at ``position`` in camera space; W as in the notation, row by row."""
    px, py, depth = position
    inv_z = dr.rcp(dr.select(visible, depth, 1))
    u, v = px * inv_z, py * inv_z  # tangents of the viewing angles
    x, y = dr.fma(camera.fx, u, camera.cx), dr.fma(camera.fy, v, camera.cy)

    left, right, top, bottom = camera.limits
    u = dr.clip(u, -left, right)
    v = dr.clip(v, -top, bottom)
    jx, jy = camera.fx * inv_z, camera.fy * inv_z
    JW = [
        [jx * (W[0][c] - u * W[2][c]) for c in range(3)],
        [jy * (W[1][c] - v * W[2][c]) for c in range(3)],
    ]
    return x, y, JW


def _along_parallel_rays(camera: DeviceCamera, W: list, position: list) -> tuple:
    """The same of a camera that sees along these."""
    px, py, _ = position
    x, y = dr.fma(camera.fx, px, camera.cx), dr.fma(camera.fy, py, camera.cy)
    return x, y, [[camera.fx * W[0][c] for c in range(3)], [camera.fy * W[1][c] for c in range(3)]]


def _pseudo_kernels(params: dict, axes, scales, log2_opacity, antialiased: bool) -> tuple[Kernels, mi.Bool]:
    """Of the M DoG primitives, from what the N primaries have, and whether their factors are numbers."""
    dr.eval(axes, scales, log2_opacity)  # in one kernel: a gather launches one for what is not evaluated yet
    dog_index = params["dog_index"]

    def of(value):
        return dr.gather(mi.Float, value, dog_index, mode=dr.ReduceMode.NoConflicts)

    m = dr.arange(mi.UInt32, dr.width(dog_index))
    log_factors = rows(params["dog_log_scales"], 3, m)
    factors = [dr.exp(f) for f in log_factors]
    pseudo = screen_kernels(
        [[of(a) for a in row] for row in axes],
        [of(s) * f for s, f in zip(scales, factors, strict=True)],
        of(log2_opacity) - LOG2_E * softplus(-params["dog_logit_opacities"]),
        antialiased,
    )
    usable = all_finite(log_factors) & ~dr.isnan(pseudo.lo)
    dr.eval(pseudo, usable)  # before the primaries gather from it, for the same reason
    return pseudo, usable


def _radiance(params: dict, camera: DeviceCamera, direction, index: mi.UInt32, visible, sh_degree: int) -> list:
    """SH + 0.5 in three channels; ``direction`` from the camera to the centres, of any length."""
    mixed = has_groups(params)
    radiance = evaluate_sh(params, direction, index, visible, 0 if mixed else sh_degree)
    if mixed and sh_degree:
        of_bands = evaluate_groups(params, camera, sh_degree)
        radiance = [color + more for color, more in zip(radiance, of_bands, strict=True)]
        if dr.grad_enabled(radiance):
            dr.schedule(radiance)  # or groups would wait for its sign, which takes all of the projection again
    return radiance


def _shifted(params: dict, offset: list, direction: list, R: list, scales: list) -> list:
    """``offset`` from the camera to where the centres are as seen along ``direction``, from that to where they are
    stored."""
    if SHIFTS.index not in params:
        return offset
    row = params[SHIFTS.row]
    there = row != NO_ROW
    shifts = rows(params["view_shifts"], SHIFT_ROW, row, there)
    views = rows(params["mean_views"], VIEW_ROW, row, there)
    moved = shift(unit(direction), R, scales, shifts, views, there)
    return [of_axis + more for of_axis, more in zip(offset, moved, strict=True)]


def _varying(params: dict, axes: list, scales: list) -> tuple[list | None, list | None, list | None]:
    """(slopes, curvatures, cuts) as ``Projection`` has them, None in a model without."""
    if not any(group.index in params for group in OWN_AXES):
        return None, None, None
    per_pixel = own_axes_per_pixel(axes, scales, scales_in_range(axes, scales))

    def on_screen(group: RowGroup, convert: Callable[[list, list[tuple]], list]) -> list:
        ((name, shape),), row = group.arrays.items(), params[group.row]
        return convert(rows(params[name], math.prod(shape), row, row != NO_ROW), per_pixel)

    slopes = on_screen(SLOPES, slopes_on_screen) if SLOPES.index in params else None
    curvatures = on_screen(CURVATURES, curvatures_on_screen) if CURVATURES.index in params else None
    cuts = [column for plane in PLANES if plane.index in params for column in on_screen(plane, cut_on_screen)]
    return slopes, curvatures, cuts or None


def project(params: dict, camera: DeviceCamera, *, sh_degree: int, antialiased: bool = False) -> Projection:
    """Project N primitives; differentiable with respect to every parameter.

    A primitive is not ``visible`` where its centre is not beyond the near plane, or a parameter is not finite (logit
    opacities of ±∞ are opacities of 0 and 1).

    Args:
        params: raw parameters as flat row-major ``mi.Float`` arrays, keys as in ``mi.traverse`` of the ``dog`` shape.
            Arrays of a group (``scene/row_groups.py`` has their names and shapes) are there when a primitive is in it,
            with its index [M] and the inverse of that, as ``dog_row`` [N] (``parameters.upload``). Groups of SH degrees
            are there where primitives have degrees of their own (``evaluate_groups``).
        camera: the view.
        sh_degree: highest degree evaluated (at most the degree stored).
        antialiased: scale opacities by the area that the low-pass filter adds (Mip-Splatting's 2D filter).
    """
    n = dr.width(params["logit_opacities"])
    index, seen_by = dr.arange(mi.UInt32, n), camera.in_each_lane(n)
    W = [seen_by.axis(k) for k in range(3)]

    offset = seen_by.offset(rows(params["means"], 3, index))
    direction = offset if camera.perspective else W[2]  # where rays are parallel, all are seen along the axis
    quats = read_rows(params["quats"], 4, 4, index)
    R = rotation_matrix(quats)
    log_scales = rows(params["log_scales"], 3, index)
    scales = [dr.exp(s) for s in log_scales]
    offset = _shifted(params, offset, direction, R, scales)
    position = [seen_by.turned(offset, axis) for axis in range(3)]
    depth = position[2]
    visible = camera.in_range(depth)
    if camera.perspective:
        x, y, JW = _through_pinhole(seen_by, W, position, visible)
    else:
        x, y, JW = _along_parallel_rays(seen_by, W, position)

    axes = [[JW[r][0] * R[0][c] + JW[r][1] * R[1][c] + JW[r][2] * R[2][c] for c in range(3)] for r in range(2)]
    log2_opacity = -LOG2_E * softplus(-params["logit_opacities"])
    kernels = screen_kernels(axes, scales, log2_opacity, antialiased)
    visible &= all_finite([x, y, kernels.ux, kernels.uy, *log_scales, *quats]) & ~dr.isnan(log2_opacity)

    pseudo, dog_row, dog_index = None, None, None
    if "dog_index" in params:
        dog_row, dog_index = params["dog_row"], params["dog_index"]
        pseudo, usable = _pseudo_kernels(params, axes, scales, log2_opacity, antialiased)
        visible &= (dog_row == NO_ROW) | dr.gather(mi.Bool, usable, dog_row, dog_row != NO_ROW)

    radiance = _radiance(params, camera, direction, index, visible, sh_degree)
    visible &= all_finite(radiance)
    colors = [dr.maximum(value, 0) for value in radiance]
    slopes, curvatures, cuts = _varying(params, axes, scales)
    for columns in (slopes, curvatures, *by_plane(cuts or [])):
        if columns:
            visible &= all_finite(columns)
    return Projection(x, y, depth, kernels, colors, visible, pseudo, dog_row, dog_index, slopes, curvatures, cuts)
