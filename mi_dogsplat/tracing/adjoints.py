"""From the adjoint of an alpha to those of the parameters of its kernels, and the other way.

A kernel is 2^(lo - Q) with Q = |M x|², x the offset where that is least on the ray. Since it is least, x may be taken
as constant: ∂Q/∂M = 2 (M x) xᵀ and ∂Q/∂μ = -2 Mᵀ M x. Of the pseudo-Gaussian the same holds with F⁻¹ M, at its own x.
"""

from __future__ import annotations

import math
from typing import Any

import drjit as dr

from ..engine.arrays import array_types, detached
from .kernels import MAX_ALPHA, Kernel, Meeting, dot, read_row
from .tree import NONE, Tree

ROW = 16  # floats: M, μ, lo; three are free
PSEUDO_ROW = 4  # floats: F⁻¹, lo_p
LN2 = math.log(2)


class Adjoints:
    """Sums of adjoints over all rays, to which the walks add."""

    def __init__(self, tree: Tree):
        Float = array_types().Float
        self.tree = tree
        self.rows = dr.zeros(Float, tree.n_leaves * ROW)
        self.pseudo = None if tree.pseudo is None else dr.zeros(Float, dr.width(tree.pseudo) // 8 * PSEUDO_ROW)
        self.sh = dr.zeros(Float, dr.width(tree.sh))

    def add_alpha(self, met: Meeting, δα: Any, active: Any) -> None:
        """Of the kernels of what is met."""
        types = array_types()
        δvalue = _unlimited(met.primary, δα, active)
        lo, pull = LN2 * δvalue, [-2 * LN2 * δvalue * y for y in met.primary.inside]
        M = [p * x for p in pull for x in met.primary.offset]
        if met.pseudo is not None:
            is_dog = active & met.is_dog
            δpseudo = LN2 * _unlimited(met.pseudo, -δα, is_dog)
            y = met.pseudo.inside
            inverse = [-2 * δpseudo * dr.square(a) / f for a, f in zip(y, met.inverse_factors, strict=True)]
            more = [-2 * δpseudo * a * f for a, f in zip(y, met.inverse_factors, strict=True)]
            M = [m + p * x for m, (p, x) in zip(M, ((p, x) for p in more for x in met.pseudo.offset), strict=True)]
            pull = [a + b for a, b in zip(pull, more, strict=True)]
            dr.scatter_add(self.pseudo, types.Quad(*inverse, δpseudo), met.dog_row, is_dog, mode=dr.ReduceMode.Local)
        mean = [-dot(pull, [row[c] for row in met.M]) for c in range(3)]
        leaf = met.leaf - self.tree.first_leaf
        row = types.Floats([*M, *mean, lo, *[types.Float(0)] * 3])
        dr.scatter_add(self.rows, row, leaf, active, mode=dr.ReduceMode.Local)

    def add_colors(self, met: Meeting, δcolors: list, basis: list, active: Any) -> None:
        """Of three channels of radiance."""
        Float, Quad = array_types().Float, array_types().Quad
        values, stride = [b * δ for b in basis for δ in δcolors], self.tree.sh_row
        size = 1 if stride % 4 else 4  # whole rows of four at once
        values += [Float(0)] * (-len(values) % size)
        for first in range(0, len(values), size):
            part = Quad(*values[first : first + 4]) if size == 4 else values[first]
            at = dr.fma(met.splat, stride // size, first // size)
            dr.scatter_add(self.sh, part, at, active, mode=dr.ReduceMode.Local)

    def of_columns(self) -> tuple[list, Any, list]:
        """(of ``Primitives.kernel``, of ``sh``, of ``pseudo``)"""
        types, tree = array_types(), self.tree
        dr.eval(self.rows, self.pseudo, self.sh)
        n, splat = dr.width(tree.sh) // tree.sh_row, tree.splat_from_leaf
        leaf = dr.arange(types.UInt, tree.n_leaves)
        kernel = []
        for k in range(13):
            column = dr.zeros(types.Float, n)
            dr.scatter(column, dr.gather(types.Float, self.rows, dr.fma(leaf, ROW, k)), splat, splat != NONE)
            kernel.append(column)
        dr.eval(kernel)  # what AD adds to a column while its scatter still waits may be lost: docs/performance.md
        if self.pseudo is None:
            return kernel, self.sh, []
        row = dr.arange(types.UInt, dr.width(self.pseudo) // PSEUDO_ROW)
        return kernel, self.sh, [dr.gather(types.Float, self.pseudo, dr.fma(row, PSEUDO_ROW, k)) for k in range(4)]


class Tangents:
    """Tangents of all parameters, which the walks read."""

    def __init__(self, tree: Tree, kernel: list, sh: Any, pseudo: list):
        types = array_types()
        n = dr.width(tree.sh) // tree.sh_row
        self.tree, self.sh = tree, _wide(sh, dr.width(tree.sh))
        self.rows = _table([_wide(c, n) for c in kernel], n, ROW)
        m = dr.width(tree.pseudo) // 8 if tree.pseudo is not None else 0
        self.pseudo = _table([_wide(c, m) for c in pseudo], m, PSEUDO_ROW) if m else None
        dr.eval(self.rows, self.pseudo, self.sh)
        self.types = types

    def of_alpha(self, met: Meeting, active: Any) -> Any:
        row = read_row(self.rows, met.splat, ROW, 13, active)
        M, mean, lo = [row[0:3], row[3:6], row[6:9]], row[9:12], row[12]

        def of_inside(kernel: Kernel) -> list:
            return [dot(δ, kernel.offset) - dot(m, mean) for δ, m in zip(M, met.M, strict=True)]

        δQ = 2 * dot(met.primary.inside, of_inside(met.primary))
        δα = _unlimited(met.primary, LN2 * (lo - δQ), active)
        if met.pseudo is None:
            return δα
        is_dog = active & met.is_dog
        *inverse, lo = read_row(self.pseudo, met.dog_row, PSEUDO_ROW, 4, is_dog)
        y, f = met.pseudo.inside, met.inverse_factors
        δy = [a * b + δ * c / a for a, b, δ, c in zip(f, of_inside(met.pseudo), inverse, y, strict=True)]
        return δα - _unlimited(met.pseudo, LN2 * (lo - 2 * dot(y, δy)), is_dog)

    def of_colors(self, met: Meeting, basis: list, active: Any) -> list:
        values = read_row(self.sh, met.splat, self.tree.sh_row, 3 * len(basis), active)
        return [sum(b * values[3 * k + channel] for k, b in enumerate(basis)) for channel in range(3)]


def _unlimited(kernel: Kernel, δ: Any, active: Any) -> Any:
    """The value times ``δ``, 0 where it is limited."""
    return dr.select(active & (kernel.value < MAX_ALPHA), kernel.value * δ, 0)


def _wide(column: Any, n: int) -> Any:
    """A tangent, which may be a single 0, as an array of its own."""
    return detached(column) + dr.zeros(array_types().Float, n)


def _table(columns: list, n: int, stride: int) -> Any:
    types = array_types()
    table, row = dr.zeros(types.Float, n * stride), dr.arange(types.UInt, n)
    for k, column in enumerate(columns):
        dr.scatter(table, column, dr.fma(row, stride, k), mode=dr.ReduceMode.Permute)
    return table
