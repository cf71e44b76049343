"""A complete binary tree over the primitives, built on the device.

The root is node 1, the children of node i are 2i and 2i + 1, and the leaves are the last half of the nodes, a primitive
each. So a walk needs no stack: a bit for each level tells whether the sibling is still to be visited (``descent.py``).

The order of the leaves comes from the top down: in each level the primitives of each node are sorted along the longest
axis of the box of their centres, all nodes by one sort, and cut in the middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import drjit as dr

from ..engine.arrays import array_types, constant, detached
from ..engine.cuts import ROW as NORMAL
from ..engine.cuts import by_plane
from ..engine.rows import NO_ROW
from .bounds import bounds_of
from .primitives import Primitives
from .row_tables import RowTable

ROW = 16  # floats: of an inner node its children's boxes; of a leaf M, μ, lo, and as bits DoG row, primitive, slope row
PSEUDO_ROW = 8  # floats: F⁻¹, weights of the common ellipsoid, lo_p; one is free
CUT_ROW = 4  # floats, of each plane: normal of the cut, and 1 where there is one
NONE = 0xFFFFFFFF  # primitive of an empty leaf
FAR = 1e30  # where the boxes of empty nodes are, points that no ray passes
OUT_OF_SIGHT = -1e30  # lo of empty leaves


@dataclass
class PlaneTable:
    """The normals of a plane."""

    rows: Any  # Float [N, CUT_ROW]
    index: Any  # UInt [C], the primitives that it cuts off


@dataclass
class Tree:
    """What walks read. Nodes are rows of one table, a cache line each."""

    nodes: Any  # Float [2 n_leaves, ROW]
    n_leaves: int
    splat_from_leaf: Any  # UInt [n_leaves], NONE where it is empty
    pseudo: Any  # Float [M, PSEUDO_ROW], or None without DoG
    slopes: RowTable | None  # axis by axis, three channels each
    curvatures: RowTable | None  # the six entries of Q
    planes: list[PlaneTable]
    shifts: RowTable | None  # G (``shifts.py``), row by row
    sh: Any  # Float [N, K, 3]
    sh_row: int  # 3 K
    middle: list  # of the root's box
    size: list

    @property
    def first_leaf(self) -> Any:
        """Number of the first leaf, opaque."""
        return constant(array_types().UInt, "first leaf", self.n_leaves)


def build(primitives: Primitives, log2_range: float) -> Tree | None:
    """The tree of the primitives that are drawn; None if none is.

    log2_range: -log2 of the smallest kernel value that is looked at.
    """
    types = array_types()
    bounds = bounds_of(primitives, log2_range)
    drawn: Any = dr.compress(bounds.drawn)  # primitives
    n = dr.width(drawn)
    if not n:
        return None
    centre = [dr.gather(types.Float, 0.5 * (a + b), drawn) for a, b in zip(bounds.low, bounds.high, strict=True)]
    dr.eval(centre)
    order = leaf_order(centre, n)
    full = order != NONE
    splat_from_leaf = dr.select(full, dr.gather(types.UInt, drawn, order, full), NONE)
    dr.eval(splat_from_leaf, full)

    leaves = dr.width(order)
    nodes = dr.zeros(types.Float, 2 * leaves * ROW)
    _write_leaves(nodes, primitives, splat_from_leaf, full)
    low, high = ([dr.select(full, dr.gather(types.Float, c, splat_from_leaf, full), empty) for c in columns]
                 for columns, empty in ((bounds.low, dr.inf), (bounds.high, -dr.inf)))
    while dr.width(low[0]) > 1:
        dr.eval(low, high)
        _write_boxes(nodes, low, high)
        low = [dr.block_reduce(dr.ReduceOp.Min, c, 2) for c in low]
        high = [dr.block_reduce(dr.ReduceOp.Max, c, 2) for c in high]
    middle = [0.5 * (a + b) for a, b in zip(low, high, strict=True)]
    size = [b - a for a, b in zip(low, high, strict=True)]
    pseudo, planes = _pseudo_table(primitives, bounds.weights), _plane_tables(primitives)
    slopes, curvatures = RowTable.of(primitives.slopes), RowTable.of(primitives.curvatures, primitives.curvature_row)
    shifts = RowTable.of(primitives.shifts, primitives.shift_row)
    sh = detached(primitives.sh)
    dr.make_opaque(middle, size)
    dr.eval(nodes, pseudo, slopes, curvatures, [plane.rows for plane in planes], shifts, sh)
    sh_row = dr.width(sh) // dr.width(primitives.lo)
    of_some = pseudo, slopes, curvatures, planes, shifts
    return Tree(nodes, leaves, splat_from_leaf, *of_some, sh, sh_row, middle, size)


def _pseudo_table(primitives: Primitives, weights: list) -> Any:
    """``Tree.pseudo``; ``weights`` as in ``Bounds``."""
    if not primitives.pseudo:
        return None
    types = array_types()
    *inverse, lo = detached(primitives.pseudo)
    pseudo = dr.zeros(types.Float, dr.width(lo) * PSEUDO_ROW)
    row = dr.arange(types.UInt, dr.width(lo))
    dr.scatter(pseudo, types.Floats([*inverse, *weights, lo, dr.zeros(types.Float)]), row)
    return pseudo


def _plane_tables(primitives: Primitives) -> list[PlaneTable]:
    """``Tree.planes``."""
    planes = []
    for plane, normal in zip(primitives.planes, by_plane(primitives.normals, NORMAL), strict=True):
        index = detached(plane.index)
        one = dr.full(array_types().Float, 1, dr.width(index))
        planes.append(PlaneTable(rows_of([*detached(normal), one], index, dr.width(primitives.lo)), index))
    return planes


def rows_of(columns: list, index: Any, n: int) -> Any:
    """Four columns [C] as a row-major table [n, 4]: row ``j`` of them in the row ``index[j]``, zeros in others."""
    types = array_types()
    rows = dr.zeros(types.Float, 4 * n)
    dr.scatter(rows, types.Quad(*columns), index, mode=dr.ReduceMode.Permute)
    return rows


def leaf_order(centre: list, n: int) -> Any:
    """[2^D] which of the n points a leaf has, NONE in those that are left over; 2^D is at least 2."""
    types = array_types()
    depth = max(1, (n - 1).bit_length())
    place = dr.arange(types.UInt, 1 << depth)
    order = dr.select(place < dr.opaque(types.UInt, n), place, NONE)
    for level in range(depth):
        order = _sorted_in_nodes(order, centre, level, depth)
    return order


def _sorted_in_nodes(order: Any, centre: list, level: int, depth: int) -> Any:
    """``order`` with the points of each node of a level in order along its longest axis, what is empty at the end."""
    types = array_types()
    block = 1 << (depth - level)
    node = dr.arange(types.UInt, 1 << depth) >> constant(types.UInt, "bits below", depth - level)
    full = order != NONE
    points = [dr.gather(types.Float, c, order, full) for c in centre]
    dr.eval(points, full)
    low = [dr.block_reduce(dr.ReduceOp.Min, dr.select(full, p, dr.inf), block) for p in points]
    high = [dr.block_reduce(dr.ReduceOp.Max, dr.select(full, p, -dr.inf), block) for p in points]
    size = [b - a for a, b in zip(low, high, strict=True)]
    axis = dr.select((size[0] >= size[1]) & (size[0] >= size[2]), types.UInt(0),
                     dr.select(size[1] >= size[2], types.UInt(1), types.UInt(2)))
    first, length = _chosen(axis, low), _chosen(axis, size)
    dr.eval(axis, first, length)
    axis, first, length = (dr.gather(type(v), v, node) for v in (axis, first, length))
    bits = min(31 - level, 23)  # of the place along the axis, below those of the node and one for what is empty
    along = dr.select(length > 0, (_chosen(axis, points) - first) / length, 0)
    along = types.UInt(along * constant(types.Float, "largest place", (1 << bits) - 1))
    key = dr.select(full, along, constant(types.UInt, "empty place", 1 << bits))
    key |= node << constant(types.UInt, "bits of a place", bits + 1)
    order = dr.gather(types.UInt, order, dr.argsort(key))
    dr.eval(order)
    return order


def _chosen(axis: Any, values: list) -> Any:
    return dr.select(axis == 0, values[0], dr.select(axis == 1, values[1], values[2]))


def _write_leaves(nodes: Any, primitives: Primitives, splat_from_leaf: Any, full: Any) -> None:
    types = array_types()
    leaf = dr.arange(types.UInt, dr.width(splat_from_leaf))
    node = leaf + constant(types.UInt, "first leaf", dr.width(splat_from_leaf))
    columns = [detached(c) for c in primitives.kernel]
    dr.eval(columns)
    *kernel, lo = (dr.gather(types.Float, c, splat_from_leaf, full) for c in columns)

    def row_of(row_of_splats: Any) -> Any:
        return dr.select(full, dr.gather(types.UInt, detached(row_of_splats), splat_from_leaf, full), NO_ROW)

    no_row = dr.full(types.UInt, NO_ROW, dr.width(leaf))
    dog_row = no_row if primitives.dog_row is None else row_of(primitives.dog_row)
    for k in (0, 4, 8):  # an empty one has a kernel, so that nothing is divided by 0
        kernel[k] = dr.select(full, kernel[k], 1)
    bits = [dr.reinterpret_array(types.Float, b) for b in (dog_row, splat_from_leaf)]
    last = dr.zeros(types.Float)
    if primitives.slope_row is not None:
        last = cast(Any, dr.reinterpret_array(types.Float, row_of(primitives.slope_row)))
    row = [*kernel, dr.select(full, lo, OUT_OF_SIGHT), *bits, last]
    dr.scatter(nodes, types.Floats(row[:8]), 2 * node)
    dr.scatter(nodes, types.Floats(row[8:]), 2 * node + 1)
    dr.eval(nodes)


def _write_boxes(nodes: Any, low: list, high: list) -> None:
    """The boxes of all nodes of a level into the rows of their parents: that of the left child, then of the right."""
    types = array_types()
    count = dr.width(low[0])
    node = dr.arange(types.UInt, count) + constant(types.UInt, "first node", count)
    at = dr.fma(node >> 1, ROW, (node & 1) * 6)
    empty = low[0] > high[0]
    for k, column in enumerate([*low, *high]):
        dr.scatter(nodes, dr.select(empty, FAR, column), at + k, mode=dr.ReduceMode.Permute)
    dr.eval(nodes)
