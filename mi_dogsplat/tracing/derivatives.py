"""Derivatives of what rays gather, by the walk once more.

The order along a ray, and what lies on it, are those of the parameters of this moment. Kernels are smooth, so that
nothing jumps but at the cutoffs, and where two primitives change places (docs/dogpath.md).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr

from ..engine.arrays import array_types
from ..engine.sh import unit_basis
from .adjoints import Adjoints, Tangents
from .blend import hides, passes, radiance
from .kernels import RayMeeting
from .varying import beyond_centre
from .vectors import dot
from .visits import TreeWalk, visit_all, visit_in_order


def transmittance_backward(walk: TreeWalk, T: Any, δT: Any) -> Adjoints:
    """``T``: what the walk has found; ``δT``: its adjoint."""
    adjoints = Adjoints(walk.tree)

    def visit(met: RayMeeting, hit: Any, unused: Any) -> tuple:
        hidden = hides(met, walk.options)
        adjoints.add_alpha(met, -δT * T / (1 - hidden), hit & (hidden == met.alpha))
        return (unused,)

    reached = replace(walk, active=walk.active & (T > 0) & (δT != 0))
    visit_all(reached, (_zeros(walk),), lambda unused: True, visit)
    return adjoints


def transmittance_forward(walk: TreeWalk, T: Any, tangents: Tangents) -> Any:
    """Tangent of the transmittance."""

    def visit(met: RayMeeting, hit: Any, δ: Any) -> tuple:
        hidden = hides(met, walk.options)
        changes = hit & (hidden == met.alpha)
        return (dr.select(changes, δ - tangents.of_alpha(met, changes) / (1 - hidden), δ),)

    reached = replace(walk, active=walk.active & (T > 0))
    (δ,) = visit_all(reached, (_zeros(walk),), lambda δ: True, visit)
    return δ * T


def gather_backward(walk: TreeWalk, colors: list, T: Any, δcolors: list, δT: Any) -> Adjoints:
    """``colors``, ``T``: what the walk has found; ``δcolors``, ``δT``: their adjoints."""
    adjoints, basis, last = Adjoints(walk.tree), unit_basis(walk.ray.d, walk.options.sh_degree), δT * T

    def visit(met: RayMeeting, walking: Any, T: Any, behind: Any) -> tuple:
        walking, T_next = passes(met, walking, T, walk.options)
        seen = radiance(walk.tree, met, basis, walking)
        weight = met.alpha * T
        of_color = sum(δ * dr.maximum(c, 0) for δ, c in zip(δcolors, seen, strict=True))
        if met.varying and met.point:
            of_color += dot(δcolors, beyond_centre(walk.tree, met.varying, met.point.w, walking))
            adjoints.add_beyond_centre(met, [δ * weight for δ in δcolors], walking)
        behind = dr.select(walking, behind - weight * of_color, behind)
        hidden = hides(met, walk.options)
        through = dr.select(hidden == met.alpha, (behind + last) / (1 - hidden), 0)
        adjoints.add_alpha(met, dr.fma(T, of_color, -through), walking)
        shown = [dr.select(c > 0, δ * weight, 0) for c, δ in zip(seen, δcolors, strict=True)]
        adjoints.add_colors(met, shown, basis, walking)
        return walking, dr.select(walking, T_next, T), behind

    behind = sum(δ * c for δ, c in zip(δcolors, colors, strict=True))
    visit_in_order(walk, (_zeros(walk) + 1, behind + _zeros(walk)), visit)
    return adjoints


def gather_forward(walk: TreeWalk, tangents: Tangents) -> tuple[list, Any]:
    """Tangents of (three channels, transmittance)."""
    basis = unit_basis(walk.ray.d, walk.options.sh_degree)

    def visit(met: RayMeeting, walking: Any, T: Any, δT: Any, *δcolors: Any) -> tuple:
        walking, T_next = passes(met, walking, T, walk.options)
        seen, δseen = radiance(walk.tree, met, basis, walking), tangents.of_colors(met, basis, walking)
        δα = tangents.of_alpha(met, walking)
        δweight = dr.fma(δα, T, met.alpha * δT)
        blended = [
            dr.select(walking & (c > 0), dr.fma(δweight, c, dr.fma(met.alpha * T, δc, δ)), δ)
            for c, δc, δ in zip(seen, δseen, δcolors, strict=True)
        ]
        if met.varying and met.point:  # not limited, as the colour of the centre is
            more = beyond_centre(walk.tree, met.varying, met.point.w, walking)
            δmore = tangents.of_beyond_centre(met, walking)
            weight = dr.select(walking, met.alpha * T, 0)
            blended = [dr.fma(dr.select(walking, δweight, 0), c, dr.fma(weight, δc, δ))
                       for c, δc, δ in zip(more, δmore, blended, strict=True)]
        hidden = hides(met, walk.options)
        δT_next = δT * (1 - hidden) - dr.select(hidden == met.alpha, δα * T, 0)
        return walking, dr.select(walking, T_next, T), dr.select(walking, δT_next, δT), *blended

    zero = _zeros(walk)
    _, δT, *δcolors = visit_in_order(walk, (zero + 1, zero, zero, zero, zero), visit)
    return δcolors, δT


def _zeros(walk: TreeWalk) -> Any:
    return dr.zeros(array_types().Float, walk.width)
