"""One step down, or up, the tree: boxes of two children against a ray, and where the walk then is.

A place is (node, trail). The trail has a bit for each level below the root, the lowest one for the level of the node:
1 where the sibling is still to be visited. So the next node is the sibling of the nearest ancestor that has a 1
(Binder and Keller 2016). A walk ends at node 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..engine.arrays import array_types
from ..engine.rows import read_row
from .kernels import Line
from .tree import ROW, Tree

SMALLEST_DIRECTION = 1e-18  # of the largest component: others are kept from 0, so that they can be divided by
T_SLACK = 1e-5  # of where a ray enters and leaves a box, against rounding


@dataclass
class Children:
    """Which children of a node are to be visited."""

    left: Any  # Bool
    right: Any
    right_first: Any


def inverse_direction(d: list) -> list:
    """1 / d, finite along every axis."""
    largest = dr.maximum(dr.maximum(abs(d[0]), abs(d[1])), abs(d[2])) * SMALLEST_DIRECTION
    return [dr.rcp(dr.select(abs(x) > largest, x, largest)) for x in d]


def children(tree: Tree, node: Any, ray: Line, inverse: list, t0: Any, t1: Any, active: Any) -> Children:
    """Those of an inner node that the ray meets between ``t0`` and ``t1``."""
    row = read_row(tree.nodes, node, ROW, 12, active)
    left, near_left = _slabs(row[:6], ray.o, inverse, t0, t1)
    right, near_right = _slabs(row[6:], ray.o, inverse, t0, t1)
    return Children(left & active, right & active, near_right < near_left)


def _slabs(box: list, o: list, inverse: list, t0: Any, t1: Any) -> tuple[Any, Any]:
    """(whether a ray meets a box, where it enters)"""
    near, far = t0, t1
    for axis in range(3):
        a, b = ((box[axis + k] - o[axis]) * inverse[axis] for k in (0, 3))
        forward = a < b
        low, high = dr.select(forward, a, b), dr.select(forward, b, a)
        near = dr.select(low > near, low, near)
        far = dr.select(high < far, high, far)
    return near <= far * (1 + T_SLACK), near


def root(active: Any) -> tuple:
    """Where a walk begins: (node, trail)."""
    UInt = array_types().UInt
    return dr.select(active, UInt(1), UInt(0)), dr.zeros(UInt, dr.width(active))


def next_place(node: Any, trail: Any, visit: Children) -> tuple:
    """The nearer child that is to be visited, else the nearest sibling on the way that is."""
    UInt = array_types().UInt
    down, both = visit.left | visit.right, visit.left & visit.right
    to_right = dr.select(both, visit.right_first, visit.right)
    up, on_the_way = dr.tzcnt(trail), trail != 0
    node = dr.select(down, 2 * node + dr.select(to_right, UInt(1), UInt(0)), dr.select(on_the_way, (node >> up) ^ 1, 0))
    trail = dr.select(down, 2 * trail + dr.select(both, UInt(1), UInt(0)), dr.select(on_the_way, (trail >> up) ^ 1, 0))
    return node, trail
