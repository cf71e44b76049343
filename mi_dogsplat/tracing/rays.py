"""Rays as the walks take them: those that are active, neighbours in space beside each other.

A packet of lanes takes as many steps as the longest of its walks, and reads as many rows as its lanes are apart. Rays
off a rough surface go everywhere; in the order of the cells where they pass the middle of the model they take half the
time, or less. In a symbolic loop, which has lanes and no arrays, rays stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from ..engine.arrays import array_types, constant, detached
from ..engine.drjit_internals import argsort_small
from .kernels import Line
from .tree import Tree
from .vectors import dot

CELL_BITS = 4  # along each axis
FEW = 1024  # rays, fewer stay in the order they have


@dataclass
class Rays:
    """Those that are walked, and where they come from."""

    line: Line
    active: Any  # Bool
    index: Any  # UInt, the ray of each lane; None where that is its own number
    width: int

    def taken(self, value: Any) -> Any:
        """Of all rays, as the lanes have them; detached."""
        value = detached(value) + dr.zeros(array_types().Float, self.width)
        return value if self.index is None else dr.gather(array_types().Float, value, self.index)

    def put(self, value: Any, otherwise: float) -> mi.Float:
        """What the lanes have found, as all rays have it."""
        if self.index is None:
            return mi.Float(value)
        result = dr.full(array_types().Float, otherwise, self.width)
        dr.scatter(result, value, self.index, mode=dr.ReduceMode.Permute)
        return mi.Float(result)


def rays_of(ray: mi.Ray3f, active: Any, tree: Tree) -> Rays:
    """``ray`` in the lanes that are ``active``, detached; in order where there are many and no symbolic loop."""
    types = array_types()
    o, d, maxt = list(detached(ray.o)), list(detached(ray.d)), detached(ray.maxt)
    width = max(dr.width(ray), dr.width(active))
    active = detached(mi.Bool(active))
    active = active & (dr.zeros(types.UInt, width) == 0)
    if dr.flag(dr.JitFlag.SymbolicScope) or width < FEW:
        return Rays(_line(o, d, maxt), active, None, width)
    dr.eval(o, d, maxt, active)
    index: Any = dr.compress(active)
    if not dr.width(index):
        return Rays(_line(o, d, maxt), active, None, width)
    index = dr.gather(types.UInt, index, _in_order_of_cells(_line(*_of(index, o, d, maxt)), tree))
    line = _line(*_of(index, o, d, maxt))
    dr.eval(line.o, line.d, line.maxt)
    return Rays(line, dr.full(dr.mask_t(types.Float), True, dr.width(index)), index, width)


def _line(o: list, d: list, maxt: Any) -> Line:
    return Line(o, d, dr.rcp(dot(d, d)), maxt)


def _of(index: Any, o: list, d: list, maxt: Any) -> tuple:
    Float = array_types().Float
    taken = [x if dr.width(x) == 1 else dr.gather(Float, x, index) for x in (*o, *d, maxt)]
    return taken[:3], taken[3:6], taken[6]


def _in_order_of_cells(line: Line, tree: Tree) -> Any:
    """Permutation of rays by the cell of the model's box where they are nearest to its middle, cells by Morton code."""
    types, cells = array_types(), 1 << CELL_BITS
    t = dot([m - o for m, o in zip(tree.middle, line.o, strict=True)], line.d) * line.inverse_square
    t = dr.clip(t, 0, line.maxt)
    key = types.UInt(0)
    for axis in range(3):
        place = (dr.fma(t, line.d[axis], line.o[axis]) - tree.middle[axis]) / dr.maximum(tree.size[axis], 1e-30) + 0.5
        place = dr.select(dr.isfinite(place), place, 0)  # NaN has no whole number, and may be a key beyond all others
        cell = types.UInt(dr.clip(place * constant(types.Float, "cells", cells), 0, cells - 1))
        for bit in range(CELL_BITS):
            key |= ((cell >> bit) & 1) << (3 * bit + axis)
    return argsort_small(key, cells**3) if types.is_llvm else dr.argsort(key)
