"""The two ways through the tree: what a ray meets in any order, and in the order along the ray.

In order it goes in rounds (3DGRT): each finds the nearest ``BUFFER`` primitives behind the last one of the round
before, by insertion into a sorted buffer whose end shortens the ray for the boxes. A primitive's key has the bits of
its place, positive and so in the order of integers, above the number of its leaf: what lies at one place, as clones do,
is met once each, in the same order by every walk.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..engine.arrays import array_types, if_stmt, while_loop
from .descent import T_SLACK, Children, children, inverse_direction, next_place, root
from .kernels import Line, RayMeeting, meet
from .options import TraceOptions
from .tree import Tree

BUFFER = 16  # primitives in a round
NOTHING = (0x7F800000 << 32) | 0xFFFFFFFF  # key at infinity

Visit = Callable[..., tuple]


@dataclass
class TreeWalk:
    """Rays on their way through a tree."""

    tree: Tree
    ray: Line
    options: TraceOptions
    active: Any  # Bool

    @property
    def width(self) -> int:
        return dr.width(self.active)

    def meet(self, node: Any, active: Any) -> RayMeeting:
        """The primitive of a leaf."""
        return meet(self.tree, node, self.ray, self.options.cutoffs, active)


def visit_all(walk: TreeWalk, state: tuple, goes_on: Callable[..., Any], visit: Visit) -> tuple:
    """Every primitive between 0 and ``ray.maxt`` with an alpha, in any order.

    ``visit(meeting, hit, *state)`` returns the next state; in lanes that are not ``hit`` there is nothing to see. A
    lane ends early where ``goes_on(*state)`` is false.
    """
    tree, ray = walk.tree, walk.ray
    first_leaf, inverse = tree.first_leaf, inverse_direction(ray.d)

    def body(node: Any, trail: Any, *state: Any) -> tuple:
        is_node = node < first_leaf

        def at_node(node: Any, *state: Any) -> tuple:
            found = children(tree, node, ray, inverse, array_types().Float(0), ray.maxt, is_node)
            return found.left, found.right, found.right_first, *state

        def at_leaf(node: Any, *state: Any) -> tuple:
            met = walk.meet(node, ~is_node)
            return *_none(node), *visit(met, ~is_node & _counts(met, ray), *state)

        left, right, right_first, *after = if_stmt((node, *state), is_node, at_node, at_leaf)
        return *next_place(node, trail, Children(left, right, right_first)), *after

    def cond(node: Any, trail: Any, *state: Any) -> Any:
        return (node != 0) & goes_on(*state)

    return while_loop((*root(walk.active), *state), cond, body, "all")[2:]


def visit_in_order(walk: TreeWalk, state: tuple, visit: Visit) -> tuple:
    """The same primitives, nearest first.

    ``visit(meeting, walking, *state)`` returns (whether the lane goes on, *the next state).
    """
    types = array_types()
    UInt, Key = types.UInt, key_type()
    inverse, n_slots = inverse_direction(walk.ray.d), dr.opaque(UInt, BUFFER)

    def step(slot: Any, walking: Any, last: Any, buffer: Any, *state: Any) -> tuple:
        key = buffer.read(slot, walking)
        walking = walking & (key != NOTHING)
        met = walk.meet(UInt(key & 0xFFFFFFFF), walking)
        walking, *after = visit(met, walking, *state)
        return slot + 1, walking, key, buffer, *after

    def round_(walking: Any, last: Any, buffer: Any, *state: Any) -> tuple:
        buffer = _nearest(walk, inverse, walking, last, buffer)
        start = dr.zeros(UInt, walk.width), walking, last, buffer, *state
        return while_loop(start, lambda slot, walking, *_: walking & (slot < n_slots), step, "blend")[1:]

    start = walk.active, dr.zeros(Key, walk.width), dr.alloc_local(Key, BUFFER), *state
    return while_loop(start, lambda walking, *_: walking, round_, "rounds")[3:]


def key_type() -> Any:
    """Integers of 64 bits."""
    return dr.uint64_array_t(array_types().Float)


def _nearest(walk: TreeWalk, inverse: list, walking: Any, last: Any, buffer: Any) -> Any:
    """``buffer`` with the keys of the nearest primitives behind ``last``, in order, NOTHING where there are no more."""
    types, tree, ray = array_types(), walk.tree, walk.ray
    Key, first_leaf = key_type(), tree.first_leaf
    t0 = _place(last) * (1 - T_SLACK)
    for slot in range(BUFFER):
        buffer.write(Key(NOTHING), types.UInt(slot), walking)

    def body(node: Any, trail: Any, t1: Any, buffer: Any) -> tuple:
        is_node = node < first_leaf

        def at_node(node: Any, t1: Any, buffer: Any) -> tuple:
            found = children(tree, node, ray, inverse, t0, t1, is_node)
            return found.left, found.right, found.right_first, t1, buffer

        def at_leaf(node: Any, t1: Any, buffer: Any) -> tuple:
            met = walk.meet(node, ~is_node)
            bits: Any = dr.reinterpret_array(types.UInt, met.t)
            key = (Key(bits) << 32) | Key(node)
            found = ~is_node & _counts(met, ray) & (key > last)
            key = farthest = dr.select(found, key, NOTHING)
            for slot in range(BUFFER):
                there = buffer.read(types.UInt(slot), found)
                farthest = dr.minimum(key, there)
                key = dr.maximum(key, there)
                buffer.write(farthest, types.UInt(slot), found)
            t1 = dr.select(found, dr.minimum(t1, _place(farthest) * (1 + T_SLACK)), t1)
            return *_none(node), t1, buffer

        left, right, right_first, t1, buffer = if_stmt((node, t1, buffer), is_node, at_node, at_leaf)
        return *next_place(node, trail, Children(left, right, right_first)), t1, buffer

    return while_loop((*root(walking), ray.maxt, buffer), lambda node, *_: node != 0, body, "nearest")[3]


def _counts(met: RayMeeting, ray: Line) -> Any:
    """Whether a primitive lies on the segment and is not below the cutoff."""
    return (met.t > 0) & (met.t < ray.maxt) & (met.alpha != 0)


def _place(key: Any) -> Any:
    """Where along the ray a key is."""
    types = array_types()
    return dr.reinterpret_array(types.Float, types.UInt(key >> 32))


def _none(node: Any) -> tuple:
    """No children."""
    no = node == 0
    return no, no, no
