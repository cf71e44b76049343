"""Where a ray sees a primitive, along the primitive's own axes, and what depends on that: its colour, and cuts.

It is the point where the primary kernel is largest on the ray, y = M x with x its offset from μ. The colour of a
primitive that varies over it, and what cuts leave of its kernels, are those at this point: one colour and one share
for each ray, of the pseudo-Gaussian too.

Where parameters change, the point moves along with them: y of the primary changes by

    P (∂M x - M ∂μ) - v (y · ∂M d) / |v|²,   v = M d,   P = I - v vᵀ / |v|²,

where d is the ray's direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, cast

import drjit as dr

from ..engine.arrays import array_types
from ..engine.cuts import END, LEVEL, WHOLE
from ..engine.rows import NO_ROW, read_row
from .primitives import PER_DEVIATION
from .row_tables import Row
from .tree import CUT_ROW, NONE, Tree
from .varying import Varying
from .vectors import cross, dot


@dataclass
class OwnPoint:
    """Where the primary is largest on the ray."""

    w: list  # in standard deviations along the axes; 0 of a primitive that neither varies nor is cut off
    d: list  # direction of the ray
    along: list  # v = M d


@dataclass
class Cut:
    """What a plane leaves of the kernels of a primitive (docs/cuts.md)."""

    normal: list  # n; 0 of a primitive that the plane leaves whole
    here: Any  # Bool, whether it does not
    kept: Any  # g
    falls: Any  # ∂ ln g / ∂(n·w)


def read_own_axes(
    tree: Tree, slope_bits: Any, splat: Any, o: list, d: list, world_d: list, active: Any
) -> tuple[OwnPoint | None, Varying | None, list[Cut]]:
    """Of a primitive on its ray; None in a model that has no use for it, and a cut for each of the model's planes.

    Args:
        slope_bits: row of its slopes, as its leaf has it.
        o, d: M (o - μ) and M d of the ray.
        world_d: direction of the ray.
    """
    varying, normals = _varying(tree, slope_bits, splat, active), []
    here = varying.here if varying else None
    for plane in tree.planes:
        *normal, there = read_row(plane.rows, splat, CUT_ROW, CUT_ROW, active & (splat != NONE))
        is_cut = there != 0
        here = is_cut if here is None else here | is_cut
        normals.append((normal, is_cut))
    if here is None:
        return None, None, []
    point = _point(o, d, world_d, here)
    return point, varying, [_cut(normal, is_cut, point.w) for normal, is_cut in normals]


def _varying(tree: Tree, slope_bits: Any, splat: Any, active: Any) -> Varying | None:
    """None in a model of which each primitive has one colour."""
    slopes = curvatures = None
    if tree.slopes is not None:
        row = cast(Any, dr.reinterpret_array(array_types().UInt, slope_bits))
        slopes = Row(row, (row != NO_ROW) & active)
    if tree.curvatures is not None:
        curvatures = tree.curvatures.row_of(splat, active & (splat != NONE))
    return Varying(slopes, curvatures) if slopes or curvatures else None


def _point(o: list, d: list, world_d: list, here: Any) -> OwnPoint:
    """That of a line which is nearest to the origin is d x (o x d) / |d|²: o + t d has no digits on a disk."""
    scale = dr.rcp(PER_DEVIATION * dot(d, d))
    w = [dr.select(here, x * scale, 0) for x in cross(d, cross(o, d))]  # what is weighted by 0 is finite
    return OwnPoint(w, world_d, d)


def _cut(normal: list, here: Any, w: list) -> Cut:
    beyond = dr.exp2(-dr.clip(dr.fma(math.log2(math.e), dot(normal, w), LEVEL), -END, END))
    kept = dr.rcp(dr.fma(beyond, WHOLE, WHOLE))
    return Cut(normal, here, kept, beyond * WHOLE * kept)


def pulled(point: OwnPoint, offset: list, δw: list) -> tuple[list, list]:
    """(adjoint of M, nine; that of M x by which μ moves) where w has the adjoint ``δw``.

    offset: x.
    """
    δy, v = [δ * (1 / PER_DEVIATION) for δ in δw], point.along
    share = dot(δy, v) / dot(v, v)
    pull = [δ - share * a for δ, a in zip(δy, v, strict=True)]
    M = [p * x - share * a * d for p, a in zip(pull, _inside(point), strict=True)
         for x, d in zip(offset, point.d, strict=True)]
    return M, pull


def moved(point: OwnPoint, inside: list, M: list, here: Any) -> list:
    """Tangent of w; 0 where not ``here``.

    Args:
        inside: tangent of M x for the x of this moment.
        M: tangent of M.
    """
    v, y = point.along, _inside(point)
    share = (dot(v, inside) + dot(y, [dot(δ, point.d) for δ in M])) / dot(v, v)
    return [dr.select(here, (δ - share * a) * (1 / PER_DEVIATION), 0) for δ, a in zip(inside, v, strict=True)]


def _inside(point: OwnPoint) -> list:
    """y, the point in kernel space."""
    return [PER_DEVIATION * w for w in point.w]
