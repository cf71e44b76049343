"""A primitive on a ray: where it is met, and the alpha there.

A kernel counts with its largest value on the ray (3DGRT), which is |o' x d'|² / |d'|² in its own space, o' and d' being
the ray there. For a Gaussian this is what EWA splatting finds if the primitive is small against its distance.

A primitive has one place on the ray: the point nearest to its centre, measured by its *cutoff ellipsoid*, the smallest
one along its axes beyond which its kernels are below the cutoff. Of a Gaussian this is where the kernel is largest, and
so it is of both kernels of a DoG primitive where F is the same along all axes. Of any other it lies between the two. A
primitive that a ray meets is met within that ellipsoid, so within its bounding box.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import drjit as dr
import numpy as np

from ..engine.arrays import array_types
from ..engine.geometry import Cutoffs
from ..engine.project import NOT_DOG
from .tables import PSEUDO_ROW, ROW, Tables

MAX_ALPHA = float(np.float32(0.99))


@dataclass
class Line:
    """Rays as the walks have them: lists of three."""

    o: list
    d: list
    inverse_square: Any  # 1 / |d|²


@dataclass
class Meeting:
    """Of one primitive and a ray."""

    t: Any  # where, in units of d
    alpha: Any  # 0 where it is below the cutoff
    index: Any  # UInt, the primitive


def line(o: list, d: list) -> Line:
    return Line(o, d, dr.rcp(dot(d, d)))


def dot(a: list, b: list) -> Any:
    return dr.fma(a[0], b[0], dr.fma(a[1], b[1], a[2] * b[2]))


def cross_square(a: list, b: list) -> Any:
    """|a x b|²"""
    x, y = dr.fma(a[1], b[2], -a[2] * b[1]), dr.fma(a[2], b[0], -a[0] * b[2])
    z = dr.fma(a[0], b[1], -a[1] * b[0])
    return dr.fma(x, x, dr.fma(y, y, z * z))


def meet(tables: Tables, row: Any, ray: Line, cutoffs: Cutoffs, active: Any) -> Meeting:
    """The primitive in a row of the table, on its ray."""
    types = array_types()
    values = list(dr.gather(types.Floats, tables.rows, row, active, shape=(ROW, dr.width(row))))
    M, mean, lo = [values[0:3], values[3:6], values[6:9]], values[9:12], values[12]
    dog_row, index = (cast(Any, dr.reinterpret_array(types.UInt, bits)) for bits in values[13:15])
    away = [o - c for o, c in zip(ray.o, mean, strict=True)]
    near = -dot(away, ray.d) * ray.inverse_square  # from here on, or o' would be as large as the distance
    away = [dr.fma(near, d, a) for a, d in zip(away, ray.d, strict=True)]
    o, d = [dot(r, away) for r in M], [dot(r, ray.d) for r in M]
    t, value = _kernel(o, d, lo)
    alpha = dr.minimum(value, MAX_ALPHA)
    if tables.pseudo is not None:
        is_dog = (dog_row != NOT_DOG) & active
        more = list(dr.gather(types.Floats, tables.pseudo, dog_row, is_dog, shape=(PSEUDO_ROW, dr.width(row))))
        F, weights, pseudo_lo = more[0:3], more[3:6], more[6]
        weighed = [w * x for w, x in zip(weights, d, strict=True)]
        t = dr.select(is_dog, -dot(weighed, o) / dot(weighed, d), t)
        o, d = ([f * x for f, x in zip(F, vector, strict=True)] for vector in (o, d))
        _, pseudo = _kernel(o, d, pseudo_lo)
        alpha = dr.select(is_dog, alpha - dr.minimum(pseudo, MAX_ALPHA), alpha)
    alpha = dr.select(abs(alpha) >= cutoffs.alpha, alpha, 0)
    return Meeting(t + near, alpha, index)


def _kernel(o: list, d: list, lo: Any) -> tuple:
    """(where on the ray it is largest, its value there)"""
    inverse = dr.rcp(dot(d, d))
    return -dot(o, d) * inverse, dr.exp2(lo - cross_square(o, d) * inverse)
