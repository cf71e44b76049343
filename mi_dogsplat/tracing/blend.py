"""What rays gather: transmittance in any order, colours and transmittance front to back."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..engine.arrays import array_types
from ..engine.geometry import MAX_T
from ..engine.rows import read_row
from ..engine.sh import unit_basis
from .kernels import RayMeeting
from .options import TraceOptions
from .tree import Tree
from .varying import beyond_centre
from .visits import TreeWalk, visit_all, visit_in_order


def transmittance(walk: TreeWalk) -> Any:
    """Float, 0 where it is below the cutoff; 1 in lanes that are not active."""
    options, low = walk.options, walk.options.cutoffs.transmittance

    def visit(met: RayMeeting, hit: Any, T: Any) -> tuple:
        return (dr.select(hit, T * (1 - hides(met, options)), T),)

    (T,) = visit_all(walk, (_ones(walk),), lambda T: T >= low, visit)
    return dr.select(T >= low, T, 0)


def gather(walk: TreeWalk) -> tuple[list, Any]:
    """(three channels, transmittance left); 0 and 1 in lanes that are not active."""
    options, basis = walk.options, unit_basis(walk.ray.d, walk.options.sh_degree)

    def visit(met: RayMeeting, walking: Any, T: Any, *colors: Any) -> tuple:
        walking, T_next = passes(met, walking, T, options)
        weight = dr.select(walking, met.alpha * T, 0)
        seen = [dr.maximum(c, 0) for c in radiance(walk.tree, met, basis, walking)]
        if met.varying and met.point:
            beyond = beyond_centre(walk.tree, met.varying, met.point.w, walking)
            seen = [c + more for c, more in zip(seen, beyond, strict=True)]
        blended = [dr.fma(weight, c, color) for c, color in zip(seen, colors, strict=True)]
        return walking, dr.select(walking, T_next, T), *blended

    zero = dr.zeros(array_types().Float, walk.width)
    T, *colors = visit_in_order(walk, (_ones(walk), zero, zero, zero), visit)
    return colors, T


def hides(met: RayMeeting, options: TraceOptions) -> Any:
    """What the transmittance is reduced by."""
    return met.alpha if options.negative_transmittance else dr.maximum(met.alpha, 0)


def passes(met: RayMeeting, walking: Any, T: Any, options: TraceOptions) -> tuple[Any, Any]:
    """(lanes that blend a primitive, the transmittance behind it)"""
    T_next = T * (1 - hides(met, options))
    return walking & (T_next >= options.cutoffs.transmittance) & (T_next <= MAX_T), T_next


def radiance(tree: Tree, met: RayMeeting, basis: list, active: Any) -> list:
    """SH + 0.5 of the primitive that is met, three channels, not yet kept from below 0."""
    values = read_row(tree.sh, met.splat, tree.sh_row, 3 * len(basis), active)
    channels = []
    for channel in range(3):
        color = array_types().Float(0.5)
        for k, b in enumerate(basis):
            color = dr.fma(b, values[3 * k + channel], color)
        channels.append(color)
    return channels


def _ones(walk: TreeWalk) -> Any:
    return dr.full(array_types().Float, 1, walk.width)
