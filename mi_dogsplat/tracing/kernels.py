"""A primitive on a ray: where it is met, and the alpha there.

A kernel counts with its largest value on the ray (3DGRT). For a Gaussian this is what EWA splatting finds, if it is
small against its distance. The largest value is that at the distance |M (o - μ) x M d| / |M d| from its centre: written
as a cross product it stays exact for disks as thin as a float.

A primitive has one place on a ray: the point nearest to its centre, measured by its cutoff ellipsoid (``bounds.py``).
Of a Gaussian this is where the kernel is largest, and so it is of both kernels of a DoG primitive where F is the same
along all axes; else it lies between the two. What a ray meets it meets in that ellipsoid, so in the primitive's box.

What varies over a primitive, its colour and what cuts leave of its kernels, has one value on a ray: that at the point
where the primary kernel is largest, which for splatting is the mean of the Gaussian along the ray (``own_axes.py``).

A primitive whose place depends on the view stands where the direction of the ray has it (``shifts.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import drjit as dr

from ..engine.arrays import array_types
from ..engine.geometry import MAX_ALPHA, Cutoffs
from ..engine.rows import NO_ROW, read_row
from .own_axes import Cut, OwnPoint, read_own_axes
from .shifts import Shift, moved_by, read_shift
from .tree import PSEUDO_ROW, ROW, Tree
from .varying import Varying
from .vectors import cross, dot


@dataclass
class Kernel:
    """One of the kernels of a primitive, on a ray."""

    value: Any  # what cuts leave of it, not yet limited to ``MAX_ALPHA``
    offset: list  # from the centre to where it is largest, world space
    inside: list  # the same in the kernel's space


@dataclass
class RayMeeting:
    """A primitive on a ray."""

    leaf: Any  # UInt, node of the tree
    splat: Any  # UInt, the primitive
    t: Any  # where, in units of the ray's direction
    alpha: Any  # 0 where it is below the cutoff
    M: list  # three rows
    primary: Kernel
    is_dog: Any  # Bool, or None in a model without DoG
    dog_row: Any
    inverse_factors: list
    pseudo: Kernel | None
    point: OwnPoint | None  # None in a model without what varies, and without cuts
    varying: Varying | None  # None in a model of which each primitive has one colour
    cuts: list[Cut]  # one of each plane that the model has
    shift: Shift | None  # None in a model without


@dataclass
class Line:
    """Rays as walks have them: lists of three."""

    o: list
    d: list
    inverse_square: Any  # 1 / |d|²
    maxt: Any


def meet(tree: Tree, node: Any, ray: Line, cutoffs: Cutoffs, active: Any) -> RayMeeting:
    """The primitive of a leaf, on its ray."""
    types = array_types()
    values = read_row(tree.nodes, node, ROW, ROW, active)
    M, mean, lo = [values[0:3], values[3:6], values[6:9]], values[9:12], values[12]
    dog_row, splat = (cast(Any, dr.reinterpret_array(types.UInt, bits)) for bits in values[13:15])
    shift = read_shift(tree, splat, ray.d, ray.inverse_square, active)
    if shift and tree.shifts:
        mean = [c + move for c, move in zip(mean, moved_by(tree.shifts, shift, active), strict=True)]
    away = [o - c for o, c in zip(ray.o, mean, strict=True)]
    near = -dot(away, ray.d) * ray.inverse_square
    away = [dr.fma(near, d, a) for a, d in zip(away, ray.d, strict=True)]  # from the centre, no longer than it must be
    o, d = [dot(row, away) for row in M], [dot(row, ray.d) for row in M]
    point, varying, cuts = read_own_axes(tree, values[15], splat, o, d, ray.d, active)
    primary, t = _kernel(o, d, lo, away, ray.d, cuts)
    alpha = dr.minimum(primary.value, MAX_ALPHA)
    is_dog, inverse, pseudo = None, [], None
    if tree.pseudo is not None:
        is_dog = (dog_row != NO_ROW) & active
        more = read_row(tree.pseudo, dog_row, PSEUDO_ROW, PSEUDO_ROW, is_dog)
        inverse, weights, pseudo_lo = [dr.select(is_dog, f, 1) for f in more[0:3]], more[3:6], more[6]
        o_p, d_p = ([f * x for f, x in zip(inverse, vector, strict=True)] for vector in (o, d))
        pseudo, _ = _kernel(o_p, d_p, pseudo_lo, away, ray.d, cuts)
        weighed = [w * x for w, x in zip(weights, d, strict=True)]
        t = dr.select(is_dog, -dot(weighed, o) / dot(weighed, d), t)
        alpha = dr.select(is_dog, alpha - dr.minimum(pseudo.value, MAX_ALPHA), alpha)
    alpha = dr.select(abs(alpha) >= cutoffs.alpha, alpha, 0)
    seen = point, varying, cuts, shift
    return RayMeeting(node, splat, t + near, alpha, M, primary, is_dog, dog_row, inverse, pseudo, *seen)


def _kernel(o: list, d: list, lo: Any, away: list, world_d: list, cuts: list[Cut]) -> tuple[Kernel, Any]:
    """(a kernel at its largest value on the ray, where that is)"""
    inverse = dr.rcp(dot(d, d))
    t = -dot(o, d) * inverse
    x, y, z = moment = cross(o, d)
    value = dr.exp2(lo - dr.fma(x, x, dr.fma(y, y, z * z)) * inverse)
    for cut in cuts:
        value = value * cut.kept
    offset = [dr.fma(t, b, a) for a, b in zip(away, world_d, strict=True)]
    inside = [c * inverse for c in cross(d, moment)]  # o + t d has no digits along the normal of a disk
    return Kernel(value, offset, inside), t
