"""``SplatTracer``: what arbitrary rays see of primitives."""

from __future__ import annotations

import copy
from typing import Any

import drjit as dr
import mitsuba as mi

from .operations import Query, asked_colors, asked_transmittance
from .options import TraceOptions
from .primitives import Primitives, primitives_of
from .rays import rays_of
from .tree import Tree, build


class SplatTracer:
    """Gathers primitives along rays.

    Made once for the parameters of this moment; rays of any number, origin and direction follow. ``ray.d`` need not be
    of length 1: ``maxt`` is in its units. A primitive belongs to the segment where its place on the ray
    (``kernels.py``) lies between 0 and ``maxt``, and is blended in the order of these places.

    **Derivatives.** Where the parameters are attached to the AD graph, so is what the methods return, in reverse and
    forward mode. Rays are taken as constant, and so is the direction that a shift depends on: a ray that is bent by a
    parameter needs another way. Call the methods outside of symbolic loops for that, one bounce after the other: within
    one they return detached values.

    **Speed.** Outside of symbolic loops rays are evaluated, those that are not active left out and the others brought
    into an order in which neighbours stay together. So ask for many rays at once.
    """

    def __init__(self, params: dict, options: TraceOptions):
        """``params``: flat arrays in world space, as ``parameters.upload`` or a shape ``dog`` has them."""
        self.options = options
        self._scene: tuple[Tree, Primitives] | None = None
        if dr.width(params["logit_opacities"]):
            primitives = primitives_of(params, options.sh_degree)
            tree = build(primitives, options.cutoffs.log2_range)
            self._scene = (tree, primitives) if tree else None

    def attached_to(self, params: dict) -> SplatTracer:
        """A tracer that shares the tree: what its methods return is attached to the AD graph where ``params`` are.

        ``params``: of the same values as those that this one was made for.
        """
        other = copy.copy(self)
        if self._scene is not None:
            other._scene = self._scene[0], primitives_of(params, self.options.sh_degree)
        return other

    def with_tangents_of(self, params: dict) -> SplatTracer:
        """``attached_to`` for forward mode, of the tangents that ``params`` have now: all its edges may be cleared."""
        other = self.attached_to(params)
        if other._scene is not None:
            other._scene = other._scene[0], other._scene[1].with_tangents()
        return other

    def transmittance(self, ray: mi.Ray3f, active: Any = True) -> mi.Float:
        """Product of 1 - alpha over the primitives between ``ray.o`` and ``ray.maxt``; for shadow rays.

        In any order. Where it falls below the cutoff of the transmittance it is 0. 1 in lanes that are not active.
        """
        if self._scene is None or not _count(ray):
            return dr.full(mi.Float, 1, _count(ray))
        tree, primitives = self._scene
        return asked_transmittance(Query(tree, self.options, rays_of(ray, active, tree)), primitives)

    def gather(self, ray: mi.Ray3f, active: Any = True) -> tuple[mi.Color3f, mi.Float]:
        """(colours blended front to back, transmittance left) of the primitives between ``ray.o`` and ``ray.maxt``.

        Colours are in the model's own space, which is sRGB or linear, and evaluated for ``ray.d``. As in splatting, the
        walk stops before the primitive that would take the transmittance below the cutoff. (0, 1) in lanes that are not
        active.
        """
        if self._scene is None or not _count(ray):
            return mi.Color3f(dr.zeros(mi.Float, _count(ray))), dr.full(mi.Float, 1, _count(ray))
        tree, primitives = self._scene
        colors, T = asked_colors(Query(tree, self.options, rays_of(ray, active, tree)), primitives)
        return mi.Color3f(*colors), T


def _count(ray: mi.Ray3f) -> int:
    """Number of rays; 0 also where what is the same for all of them is one number."""
    return dr.width(ray) if dr.width(ray.o) and dr.width(ray.d) else 0
